// What the page says of buildings: the panel of one, the table of all, the histograms.

const GRADES = ["good", "check", "poor"];
/** A name without what nearly all begin with. */
const shortName = (name) => name.replace(/^building-/, "");
const chip = (known) => {
  const found = element("span", { className: "chip", textContent: standing(known) });
  found.style.background = standingColour(known);
  return found;
};

/** Attributes that the panel and the table name: title, value with unit, what it means. */
const SHOWN = {
  height: ["Height", (known, unit) => known.height == null ? null : `${rounded(known.height * unit, 1)} m`, "of the roof's 70th percentile above the ground"],
  top: ["Highest point", (known, unit) => known.roof_elevation_max == null || known.ground_elevation == null ? null : `${rounded((known.roof_elevation_max - known.ground_elevation) * unit, 1)} m`, "above the ground"],
  area: ["Footprint", (known, unit) => known.area == null ? null : `${rounded(known.area * unit ** 2, 0)} m²`, "area within the outline"],
  volume: ["Volume", (known, unit) => known.volume == null ? null : `${rounded(known.volume * unit ** 3, 0)} m³`, "of the finest solid"],
  roof_type: ["Roof", (known) => known.roof_type ? known.roof_type + (known.n_planes ? `, ${known.n_planes} plane${known.n_planes === 1 ? "" : "s"}` : "") : null, ""],
  conditions: ["Planes", (known) => known.conditions || null, "what they have in common, and what the points refuse"],
  lod: ["Level of detail", (known) => known.lod ? `LoD${known.lod}` : null, "the finest there is"],
  rmse: ["Accuracy", (known, unit) => known.rmse == null ? null : `${rounded(known.rmse * unit, 2)} m`, "of points to the model, root mean square"],
  outline_sigma: ["Outline", (known, unit) => known.outline_sigma == null ? null : `± ${rounded(known.outline_sigma * unit, 2)} m`, "of traced points to it"],
  corners: ["Corners", (known, unit) => known.corner_sigma_z == null ? null : (known.corner_sigma_xy == null ? "" : `± ${rounded(known.corner_sigma_xy * unit, 2)} m in plan, `) + `± ${rounded(known.corner_sigma_z * unit, 2)} m in height`, "standard deviations of the roof's corners, medians"],
};

/** Fill the panel with what is known of a building; `faces` are its measured roof faces. */
function fillPanel(panel, facts, row, { faces, n }, level, acts) {
  const known = facts.attributes[row], name = facts.names[row];
  const reasons = [...(known.quality_reasons ?? "").split("; "), known.status && known.status !== "ok" ? `${known.status}: ${known.reason ?? ""}` : ""].filter(Boolean);
  const rows = Object.values(SHOWN).map(([title, value, meaning]) => [title, value(known, facts.unit), meaning]).filter(([, value]) => value != null);
  const button = (text, label, act) => element("button", { type: "button", textContent: text, ariaLabel: label, title: label, onclick: act });
  const details = (title, isOpen, ...children) => element("details", { open: isOpen }, element("summary", title), ...children);
  const few = faces.slice(0, 40).map((one) => [`${one.number}`, `${one.slope.toFixed(0)}°`, `${one.area.toFixed(1)} m²`, `${one.n}`, one.rmse == null ? "–" : `${one.rmse.toFixed(2)} m`]);
  const raw = Object.keys(known).filter((one) => known[one] != null && known[one] !== "").map((one) => [one, written(known[one])]);
  panel.replaceChildren(
    element("div", { className: "panel-head" }, element("h2", {}, element("a", { href: `#building=${encodeURIComponent(name)}`, textContent: name, title: "link to this building" })),
      button("◎", "fly there (f)", acts.fly), button("×", "close (Escape)", acts.close)),
    element("p", {}, chip(known), reasons.length ? "" : " nothing speaks against it"),
    element("ul", { className: "reasons" }, ...reasons.map((one) => element("li", one))),
    element("dl", {}, ...rows.map(([title, value, meaning]) => element("div", {}, element("dt", title), element("dd", {}, element("b", value), element("small", meaning))))),
    ...(faces.length ? [details(`${faces.length} roof face${faces.length === 1 ? "" : "s"} at LoD${(level / 10).toFixed(1)}`, false, table([["face", "slope", "area", "points", "rmse"], ...few]),
      element("p", { className: "hint", textContent: `${faces.length > few.length ? `The largest ${few.length}. ` : ""}From the ${n.toLocaleString("en")} points of the building that the page holds.` }))] : []),
    details("All attributes, as in the files", false, table(raw)),
  );
  panel.hidden = false;
}

/** The table of all buildings, to be searched, filtered and sorted. */
class BuildingTable {
  static COLUMNS = ["name", "grade", "height", "area", "volume", "roof_type", "lod", "rmse"];
  static FIRST = innerWidth < 700 ? 20 : 100;

  constructor(facts, { select, filter }) {
    this.facts = facts;
    this.acts = { select, filter };
    this.sorted = ["grade", -1];
    this.selected = -1;
    this.most = BuildingTable.FIRST;
    const every = facts.attributes;
    this.columns = BuildingTable.COLUMNS.filter((one) => ["name", "grade"].includes(one) || every.some((known) => known[one] != null && known[one] !== ""));
    for (const [id, of] of [["only-grade", standing], ["only-roof", (known) => known.roof_type]]) {
      const counts = new Map();
      every.map(of).filter(Boolean).forEach((one) => counts.set(one, (counts.get(one) ?? 0) + 1));
      for (const [one, n] of [...counts].sort()) byId(id).add(new Option(`${one} (${n})`, one));
      byId(id).hidden = !counts.size;
      byId(id).addEventListener("change", () => this.changed());
    }
    byId("search").addEventListener("input", () => this.changed());
    byId("more").addEventListener("click", () => { this.most = Infinity; this.fill(); });
    const titles = { name: "Building", grade: standing(every[0] ?? {}) in { good: 1, check: 1, poor: 1 } ? "Grade" : "Status" };
    byId("rows-head").append(...this.columns.map((one) => element("th", { scope: "col", className: `of-${one}` },
      element("button", { type: "button", textContent: titles[one] ?? SHOWN[one][0], onclick: () => this.sort(one) }))));
    this.changed();
  }

  value(row, column) {
    const known = this.facts.attributes[row];
    if (column === "name") return this.facts.names[row];
    if (column === "grade") return GRADES.indexOf(standing(known));
    return known[column] === "" ? null : known[column];
  }

  sort(column) {
    this.sorted = [column, this.sorted[0] === column ? -this.sorted[1] : column === "name" || column === "roof_type" ? 1 : -1];
    this.fill();
  }

  /** Choose the rows that search and filters leave. */
  changed() {
    const words = byId("search").value.toLowerCase().split(/\s+/).filter(Boolean), [grade, roof] = [byId("only-grade").value, byId("only-roof").value];
    const { names, attributes } = this.facts;
    this.rows = names.map((_, row) => row).filter((row) => {
      const known = attributes[row], text = `${names[row]} ${known.footprint_id ?? ""} ${known.building_id ?? ""} ${known.quality_reasons ?? ""} ${known.reason ?? ""} ${known.roof_type ?? ""}`.toLowerCase();
      return (!grade || standing(known) === grade) && (!roof || known.roof_type === roof) && words.every((one) => text.includes(one));
    });
    byId("found").textContent = `${this.rows.length.toLocaleString("en")} of ${names.length.toLocaleString("en")}`;
    this.acts.filter(this.rows);
    this.fill();
  }

  fill() {
    const [column, sign] = this.sorted, isEmpty = (value) => value == null;
    const order = (a, b) => {
      const [x, y] = [this.value(a, column), this.value(b, column)];
      if (isEmpty(x) || isEmpty(y)) return isEmpty(x) - isEmpty(y);
      return sign * (typeof x === "string" ? x.localeCompare(y, "en", { numeric: true }) : x - y) || a - b;
    };
    const rows = [...this.rows].sort(order);
    [...byId("rows-head").children].forEach((head, k) => (head.ariaSort = this.columns[k] === column ? (sign > 0 ? "ascending" : "descending") : "none"));
    byId("rows").replaceChildren(...rows.slice(0, this.most).map((row) => this.line(row)));
    byId("more").hidden = rows.length <= this.most;
    byId("more").textContent = `show all ${rows.length.toLocaleString("en")}`;
  }

  line(row) {
    const { attributes, names, unit } = this.facts, known = attributes[row];
    const cells = this.columns.map((one) => {
      const cell = element("td", { className: `of-${one}` });
      if (one === "name") cell.append(element("a", { href: `#building=${encodeURIComponent(names[row])}`, textContent: shortName(names[row]) }));
      else if (one === "grade") cell.append(chip(known));
      else cell.append(SHOWN[one][1](known, unit) ?? "–");
      return cell;
    });
    return element("tr", { className: row === this.selected ? "chosen" : "", onclick: (event) => { event.preventDefault(); this.acts.select(row); } }, ...cells);
  }

  select(row) {
    this.selected = row ?? -1;
    this.fill();
  }
}

/** An element of SVG with attributes and children. */
function svg(name, attributes = {}, ...children) {
  const found = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [name, value] of Object.entries(attributes)) found.setAttribute(name, value);
  found.append(...children);
  return found;
}

/** Bars of whole bins, and one apart for what lies beyond the last; counts at the axis and on each bar. */
function histogram({ title, counts, from, step, beyond, median, unit }, width) {
  const most = Math.max(...counts, beyond, 1), n = counts.length + (beyond ? 2 : 0), [left, right, top, foot] = [34, 22, 12, 112];
  const wide = (width - left - right) / n, tall = (count) => ((foot - top) * count) / most, x = (value) => left + ((value - from) / step) * wide;
  const digits = step < 0.01 ? 3 : 2, text = (at, y, words, anchor = "middle") => svg("text", { x: at, y, "text-anchor": anchor }, words);
  const bar = (count, k, words, kind) => svg("rect", { x: left + k * wide + 0.5, y: foot - tall(count), width: Math.max(wide - 1, 1), height: tall(count), class: kind }, svg("title", {}, `${words}: ${count} building${count === 1 ? "" : "s"}`));
  const edge = (k) => (from + k * step).toFixed(digits), every = Math.ceil((counts.length * 46) / (width - left - right)) || 1;
  const ticks = counts.map((_, k) => k).concat(counts.length).filter((k) => k % every === 0 && !(beyond && k === counts.length));
  const total = counts.reduce((sum, one) => sum + one, beyond);
  const last = from + counts.length * step, shown = svg("svg", { width, height: 134, role: "img", "aria-label": `${title}: median ${median.toFixed(digits)}${unit} of ${total} buildings` },
    svg("path", { class: "axis", d: `M${left} ${top} H${width - right} M${left} ${foot} H${width - right}` }), text(left - 6, top + 4, most, "end"), text(left - 6, foot + 4, 0, "end"),
    ...counts.map((count, k) => bar(count, k, `${edge(k)} to ${edge(k + 1)}${unit}`, "bin")), ...ticks.map((k) => text(left + k * wide, foot + 16, edge(k))),
    ...(beyond ? [bar(beyond, n - 1, `above ${edge(counts.length)}${unit}`, "beyond"), text(width - right, foot + 16, `> ${edge(counts.length)}`, "end")] : []),
    svg("line", { x1: x(Math.min(median, last)), x2: x(Math.min(median, last)), y1: top - 6, y2: foot, class: "median" }));
  return element("figure", {}, element("figcaption", {}, element("b", title), ` median ${median.toFixed(digits)}${unit}, ${total.toLocaleString("en")} building${total === 1 ? "" : "s"}${beyond ? `, ${beyond} above ${edge(counts.length)}${unit}` : ""}`), shown);
}
