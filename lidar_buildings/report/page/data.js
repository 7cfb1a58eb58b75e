// The page's data: arrays and facts, inflated from the elements that hold them; and small pieces of the page.

const TYPES = { uint8: Uint8Array, uint16: Uint16Array, uint32: Uint32Array, int16: Int16Array, int32: Int32Array };

async function inflated(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

/** Return {facts, name: {array, shape}} of all elements whose id begins with data-. */
async function loadData() {
  const data = {};
  for (const element of document.querySelectorAll('script[id^="data-"]')) {
    const name = element.id.slice("data-".length), { type, shape } = element.dataset;
    const buffer = await inflated(element.textContent);
    data[name] = type === "json"
      ? JSON.parse(new TextDecoder().decode(buffer))
      : { array: new TYPES[type](buffer), shape: shape.split(",").map(Number) };
  }
  return data;
}

const byId = (id) => document.getElementById(id);
const clamped = (value, low, high) => Math.min(Math.max(value, low), high);
const written = (value) => (typeof value === "number" && !Number.isInteger(value) ? String(+value.toFixed(4)) : String(value));
const rounded = (value, digits) => value.toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits });

/** An element with a text, or with properties and children. */
function element(name, properties = {}, ...children) {
  const found = Object.assign(document.createElement(name), typeof properties === "string" ? { textContent: properties } : properties);
  found.append(...children);
  return found;
}

function key(colour, text) {
  const mark = element("i");
  mark.style.background = colour;
  return element("div", { className: "key" }, mark, text);
}

function table(rows) {
  return element("table", {}, ...rows.map((cells) => element("tr", {}, ...cells.map((cell) => element("td", cell)))));
}

/** Whether the page is dark: as chosen, or as the system is. */
const isDark = () => (document.documentElement.style.colorScheme || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";
