// A pass through a report in headless Chromium: does what hands, keys and links do, and prints what came of it.
//
//     npm install playwright-core        (in a folder of your own)
//     NODE_PATH=.../node_modules node bench/pages/report_pass.cjs DIR/report.html PICTURES [/usr/bin/chromium]
//
// Ends with status 1 if a check fails, a message is on the console, or anything is fetched.

const fs = require("fs");
const path = require("path");
const { chromium } = require("playwright-core");

const [file, pictures, executablePath = "/usr/bin/chromium"] = process.argv.slice(2);
const FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
  "--disable-background-networking", "--disable-component-update", "--disable-sync"];
const WIDE = { width: 1440, height: 900 }, PHONE = { width: 390, height: 844 };
let nFailed = 0;

function check(what, isGood, told = "") {
  nFailed += !isGood;
  console.log(`${isGood ? "ok  " : "FAIL"} ${what}${told === "" ? "" : `: ${told}`}`);
}

async function opened(browser, options = {}, hash = "") {
  const context = await browser.newContext({ viewport: WIDE, offline: true, ...options }), page = await context.newPage();
  page.heard = [];
  page.on("console", (message) => page.heard.push(message.text()));
  page.on("pageerror", (error) => page.heard.push(String(error)));
  page.on("request", (request) => request.url().startsWith("file:") || request.url().startsWith("data:") || page.heard.push(request.url()));
  await page.goto(`file://${path.resolve(file)}${hash}`);
  await page.waitForSelector("body[data-state=ready]", { timeout: 120000 });
  await page.waitForTimeout(800);
  return page;
}

const picture = (page, name, more = {}) => page.screenshot({ path: path.join(pictures, `${name}.png`), ...more });
const settled = (page) => page.waitForFunction(() => !viewer.flight && viewer.pending == null, null, { timeout: 30000 });

/** The place under a pixel, and the pixel of a place. */
const placeAt = (page, at) => page.evaluate((at) => viewer.placeUnder(at), at);
const pixelOf = (page, place) => page.evaluate((place) => {
  const [x, y] = viewer.camera.projected(place, viewer.aspect);
  return [((x + 1) / 2) * canvas.clientWidth, ((1 - y) / 2) * canvas.clientHeight];
}, place);

async function onWideScreens(browser) {
  const page = await opened(browser), names = await page.evaluate(() => viewer.facts.names);
  await picture(page, "wide");
  check("points are off", !(await page.isChecked("#show-points")) && (await page.evaluate(() => !viewer.drawing.layers.points)));
  check("four figures over the scene", (await page.locator(".figures > div").count()) === 4);

  const at = [980, 420], place = await placeAt(page, at);
  await page.mouse.move(...at);
  for (let n = 0; n < 6; n++) await page.mouse.wheel(0, -240);
  await settled(page);
  const off = Math.hypot(...(await pixelOf(page, place)).map((value, axis) => value - at[axis]));
  check("the wheel comes nearer to what is under the cursor", off < 3, `${off.toFixed(2)} pixels off`);
  for (let n = 0; n < 60; n++) await page.mouse.wheel(0, -400);
  await settled(page);
  const clear = await page.evaluate(() => viewer.camera.clearance());
  check("the eye stays out of walls", clear > 1.4, `${clear.toFixed(1)} m above what is solid`);
  await picture(page, "near");

  await page.focus("#canvas");
  const before = await page.evaluate(() => viewer.camera.state);
  for (const key of ["ArrowLeft", "ArrowUp", "Shift+ArrowLeft", "q", "+"]) await page.keyboard.press(key);
  const after = await page.evaluate(() => viewer.camera.state);
  check("keys move, turn and come nearer", after.azimuth !== before.azimuth && after.target[0] !== before.target[0]);
  await page.keyboard.press("t");
  await settled(page);
  check("t looks from above", Math.abs((await page.evaluate(() => viewer.camera.tilt)) - Math.PI / 2) < 1e-6);
  await page.keyboard.press("h");
  await settled(page);

  await page.locator("#rows tr").nth(1).click();
  await settled(page);
  const name = await page.evaluate(() => viewer.facts.names[viewer.selected - 1]);
  check("a row of the table opens the panel, and the address names the building", (await page.textContent("#panel h2")) === name && page.url().endsWith(`#building=${name}`));
  await page.waitForTimeout(600);
  await picture(page, "panel");
  await page.keyboard.press("Escape");
  check("Escape closes it", await page.isHidden("#panel"));
  await page.evaluate((name) => (location.hash = `building=${name}`), names[0]);
  await page.waitForSelector("#panel:not([hidden])");
  check("a changed address is followed", (await page.textContent("#panel h2")) === names[0]);

  const grade = await page.evaluate(() => standing(viewer.facts.attributes[0])), count = await page.evaluate((grade) => viewer.facts.attributes.filter((one) => standing(one) === grade).length, grade);
  await page.selectOption("#only-grade", grade);
  check("the table filters by grade", (await page.textContent("#found")).startsWith(`${count} of`), await page.textContent("#found"));
  await page.fill("#search", names[0]);
  check("and searches", (await page.locator("#rows tr").count()) === 1);
  await page.fill("#search", "");
  await page.selectOption("#only-grade", "");
  await page.locator("#rows-head .of-area button").click();
  const areas = await page.evaluate(() => [...document.querySelectorAll("#rows .of-area")].map((one) => parseFloat(one.textContent.replace(/,/g, ""))));
  check("and sorts", areas.every((one, k) => !k || one <= areas[k - 1]));

  await page.evaluate(() => viewer.select(null));
  await page.locator("#plan").scrollIntoViewIfNeeded();
  const spot = await page.evaluate(() => {
    const { scene, map } = viewer, { building, places } = scene.rings(OUTLINE).reduce((a, b) => (a.places.length > b.places.length ? a : b)), [x, y] = places[0];
    const box = scene.boxOf(building), inward = [0, 1].map((axis) => Math.sign((box[0][axis] + box[1][axis]) / 2 + scene.centre[axis] - places[0][axis]));
    const pixel = ([x, y]) => [map.canvas.clientWidth / 2 + (x - map.middle[0]) * map.scale, map.canvas.clientHeight / 2 - (y - map.middle[1]) * map.scale];
    const around = [[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1], inward].map(([a, b]) => pixel([x + 0.7 * a, y + 0.7 * b]));
    return { building, at: around.find((at) => map.rowAt(at) === building) };
  });
  await page.locator("#map").click({ position: { x: spot.at[0], y: spot.at[1] } });
  check("a click on the map chooses the building", (await page.evaluate(() => viewer.selected - 1)) === spot.building);
  const scale = await page.evaluate(() => viewer.map.scale);
  await page.locator("#map-nearer").click();
  await page.locator("#map").press("ArrowLeft");
  check("the map moves and zooms", (await page.evaluate(() => viewer.map.scale)) > scale);
  await picture(page, "map");
  const yards = await page.evaluate(() => {
    const { scene, map } = viewer, count = new Map(), wrong = [];
    for (const ring of scene.rings(OUTLINE)) count.set(ring.building, [...(count.get(ring.building) ?? []), ring.places]);
    map.home();
    for (const [building, [, ...holes]] of count)
      for (const hole of holes) {
        const [x, y] = [0, 1].map((axis) => hole.reduce((sum, one) => sum + one[axis], 0) / hole.length);
        const inside = hole.reduce((odd, [ax, ay], k) => { const [bx, by] = hole[(k + 1) % hole.length]; return ay > y !== by > y && x < ((bx - ax) * (y - ay)) / (by - ay) + ax ? !odd : odd; }, false);
        const at = [map.canvas.clientWidth / 2 + (x - map.middle[0]) * map.scale, map.canvas.clientHeight / 2 - (y - map.middle[1]) * map.scale];
        if (inside && map.rowAt(at) === building) wrong.push(building);
      }
    return [[...count.values()].reduce((sum, rings) => sum + rings.length - 1, 0), wrong.length];
  });
  check("courtyards are empty", yards[1] === 0, `${yards[0]} courtyards`);
  await picture(page, "whole", { fullPage: true });
  await framesPerSecond(page);
  check("nothing on the console, nothing fetched", page.heard.length === 0, page.heard.slice(0, 3).join(" | "));
}

/** Frames drawn in 6 s of turning, after 4 s of the same. */
async function framesPerSecond(page) {
  await page.evaluate(() => { viewer.select(null); viewer.home(false); scrollTo({ top: 0, behavior: "instant" }); });
  await page.evaluate(() => {
    const frame = viewer.frame.bind(viewer);
    viewer.n = 0;
    viewer.frame = (now) => { viewer.n += viewer.isMoving; frame(now); };
  });
  await page.mouse.move(720, 500);
  await page.mouse.down();
  const turn = async (time) => {
    const start = Date.now();
    for (let k = 0; Date.now() - start < time; k++) {
      await page.mouse.move(720 + 200 * Math.sin(k / 20), 500 + 40 * Math.sin(k / 31));
      await page.waitForTimeout(5);
    }
    return Date.now() - start;
  };
  await turn(4000);
  const before = await page.evaluate(() => viewer.n), cpu = processorTime(), time = await turn(6000), n = (await page.evaluate(() => viewer.n)) - before;
  await page.mouse.up();
  console.log(`     ${((1000 * n) / time).toFixed(1)} frames/s while turning, ${((processorTime() - cpu) / n).toFixed(0)} ms of processor time each, load ${fs.readFileSync("/proc/loadavg", "utf8").split(" ")[0]}`);
}

/** Processor time that the browser's processes have taken [ms]. */
function processorTime() {
  const known = new Map();
  for (const id of fs.readdirSync("/proc").filter((one) => /^\d+$/.test(one)))
    try {
      const fields = fs.readFileSync(`/proc/${id}/stat`, "utf8").replace(/\(.*\)/, "x").split(" ");
      known.set(Number(id), { parent: Number(fields[3]), time: 10 * (Number(fields[13]) + Number(fields[14])) });
    } catch { /* it has ended */ }
  const isOurs = (id) => id === process.pid || (known.has(id) && known.get(id).parent > 1 && isOurs(known.get(id).parent));
  return [...known].filter(([id]) => id !== process.pid && isOurs(id)).reduce((sum, [, one]) => sum + one.time, 0);
}

async function onPhones(browser) {
  const page = await opened(browser, { viewport: PHONE, hasTouch: true, isMobile: true, deviceScaleFactor: 2 });
  await picture(page, "phone");
  const wide = await page.evaluate(() => document.documentElement.scrollWidth);
  check("nothing is wider than the phone", wide <= PHONE.width, `${wide} pixels`);
  const touch = await page.context().newCDPSession(page), distance = () => page.evaluate(() => viewer.camera.distance), start = await distance();
  const fingers = (type, half) => touch.send("Input.dispatchTouchEvent", { type, touchPoints: half == null ? [] : [{ x: 195 - half, y: 450, id: 0 }, { x: 195 + half, y: 450, id: 1 }] });
  const place = await placeAt(page, [195, 450]);
  await fingers("touchStart", 40);
  for (let half = 45; half <= 120; half += 5) await fingers("touchMove", half);
  await fingers("touchEnd");
  await settled(page);
  const off = Math.hypot(...(await pixelOf(page, place)).map((value, axis) => value - [195, 450][axis]));
  check("a pinch comes nearer to what is between the fingers", (await distance()) < 0.5 * start && off < 8, `${(start / (await distance())).toFixed(2)} times, ${off.toFixed(1)} pixels off`);
  const azimuth = await page.evaluate(() => viewer.camera.azimuth);
  for (const [type, x] of [["touchStart", 200], ["touchMove", 230], ["touchMove", 260]]) await touch.send("Input.dispatchTouchEvent", { type, touchPoints: [{ x, y: 420 }] });
  await touch.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] });
  check("one finger turns", (await page.evaluate(() => viewer.camera.azimuth)) !== azimuth);
  await page.evaluate(() => viewer.home(false));
  await page.evaluate(() => viewer.select(viewer.facts.worst[0]?.row ?? 0, true));
  await settled(page);
  await page.waitForTimeout(600);
  await picture(page, "phone_panel");
  await page.evaluate(() => viewer.select(null));
  await picture(page, "phone_whole", { fullPage: true });
  check("nothing on the console, nothing fetched", page.heard.length === 0, page.heard.slice(0, 3).join(" | "));
}

async function main() {
  fs.mkdirSync(pictures, { recursive: true });
  const browser = await chromium.launch({ executablePath, args: FLAGS });
  await onWideScreens(browser);
  await onPhones(browser);
  const dark = await opened(browser, { colorScheme: "dark" });
  await picture(dark, "dark");
  await picture(dark, "dark_whole", { fullPage: true });
  const name = await dark.evaluate(() => viewer.facts.names[viewer.facts.names.length - 1]), linked = await opened(browser, {}, `#building=${name}`);
  check("a link opens its building", (await linked.textContent("#panel h2")) === name);
  await browser.close();
  process.exitCode = nFailed ? 1 : 0;
}

main();
