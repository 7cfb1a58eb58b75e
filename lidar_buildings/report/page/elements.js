// Small pieces of the page.

const byId = (id) => document.getElementById(id);
const element = (name, text) => Object.assign(document.createElement(name), { textContent: text });
const written = (value) => (typeof value === "number" && !Number.isInteger(value) ? String(+value.toFixed(4)) : String(value));

function key(colour, text) {
  const line = element("div", ""), mark = document.createElement("i");
  line.className = "key";
  mark.style.background = colour;
  line.append(mark, text);
  return line;
}

function table(rows) {
  const found = document.createElement("table");
  for (const cells of rows) {
    const row = found.insertRow();
    for (const cell of cells) row.insertCell().textContent = cell;
  }
  return found;
}
