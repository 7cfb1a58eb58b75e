// The page's data: arrays and facts, inflated from the elements that hold them.

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

/** Return the elevation of a raster's cell under a place [m], null where it is unknown. */
function elevationAt(relief, facts, x, y) {
  if (!relief) return null;
  const [rows, columns] = relief.shape;
  const column = Math.floor((x - facts.west) / facts.cell[0]), row = Math.floor((facts.north - y) / facts.cell[1]);
  if (row < 0 || column < 0 || row >= rows || column >= columns) return null;
  const steps = relief.array[row * columns + column];
  return steps === facts.unknown ? null : facts.middle + steps * facts.step;
}
