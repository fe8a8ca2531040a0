// The page to fly: it says what was chosen and held, and shows the frames and numbers that the server sends.

import { Chart, RiverMap } from "./map.js";
import { Controls, inWords } from "./controls.js";

const $ = (id) => document.getElementById(id);
const map = new RiverMap($("map")), chart = new Chart($("chart")), form = $("options");
const RATE_FRAMES = 30, NUMBERS_MS = 80;
const TRIES = 10, TRY_MS = 2000; // to connect again: for longer than the server keeps a silent connection, see app.py
const VIOLATION = 1008, TRY_LATER = 1013, STOPPED = 1012; // codes of the server, see guard.py, app.py and uvicorn
const decoder = new TextDecoder();

let socket = null;
let choices = null; // what the server offers
let flight = null; // what it told of the current flight
let latest = null; // the numbers of the last frame
let pace = { moving: false, speed: 1 };
let lastPilot = "pilot"; // to whom P hands back
let stepping = false; // whether a step by a key is on its way
let shownAt = [];
let drawnAt = 0; // when map, chart and numbers were drawn last
let tries = 0; // since the connection broke
let lost = null; // options of the flight that was lost with it, and who flew
let flies = null; // who flies, once that is known
let asked = null; // who shall fly, until a frame shows it
let complaint = ""; // of the next flight
let shown = Promise.resolve(); // when the last frame that has come is shown

const say = (type, about = {}) => {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ type, ...about }));
};

function connect() {
  const address = new URL("socket", location.href);
  address.protocol = "ws:";
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => (typeof data === "string" ? hear(JSON.parse(data)) : showInTurn(data));
  socket.onclose = closed;
}

/** Say why a connection ended. One that broke is tried again a few times: the server may still be there. */
function closed({ code, reason }) {
  $("where").textContent = "not connected";
  enable(false);
  lost ??= flight && { options: flight.options, pilot: asked ?? flies };
  // A server may count this page's broken connection among its tabs until it notices, so a full one is tried again.
  const full = code === TRY_LATER && (!tries || tries === TRIES);
  if (code === VIOLATION || full) return notice("The connection is closed", reason);
  if (code === STOPPED) return notice("The server has stopped", "Start it again and open its new address.");
  if (tries === TRIES) {
    return notice("The server cannot be reached", "It has stopped, or the way to it is broken. Reload this page to try again.");
  }
  tries += 1;
  notice("The connection is broken", `Trying again, ${tries} of ${TRIES}. What was not saved of the flight is lost.`);
  setTimeout(connect, TRY_MS);
}

function enable(on) {
  for (const control of document.querySelectorAll("button, select, input")) control.disabled = !on;
}

const HEARD = {
  hello(told) {
    choices = told;
    if (tries) enable(true);
    tries = 0;
    fill($("pilot"), told.pilots);
    fill($("picture"), told.pictures);
    fill(form.elements.task, Object.keys(told.tasks));
    fill(form.elements.look, told.looks);
    setForm(told.options);
    say("record", { on: $("record").checked });
    controls.cruise = $("cruise").checked;
    controls.repeat();
  },
  busy: ({ message }) => notice(`${message} …`, ""),
  started(told) {
    if (lost) return again();
    flight = told;
    latest = null;
    map.begin(told.map);
    chart.begin();
    setForm(told.options);
    complain(complaint);
    complaint = "";
    const { level, world_seed: seed, task } = told.options;
    $("where").textContent = `${level}, river ${seed}, ${told.map.length_m} m, task ${task}, start ${told.options.seed}`;
    [$("height").min, $("height").max] = told.heights;
    const back = told.fast ? "fast forward" : "back";
    for (const word of document.querySelectorAll(".back-word")) word.textContent = back;
    document.querySelector(".back small").textContent = told.fast ? "fast" : "back";
    notice("Drawing the first picture …", "the first start on a machine compiles for a minute or two");
    say("view", view());
  },
  pace(told) {
    pace = told;
    $("go").textContent = told.moving ? "Pause" : "Fly";
    stepping = false;
    if (told.moving) notice();
    else if (latest && !latest.ended) notice("Paused", "Space flies on; a flight key flies one step");
  },
  flights({ names }) {
    $("list").replaceChildren(...names.map((name) => {
      const item = document.createElement("li"), button = document.createElement("button");
      button.textContent = "Replay";
      button.onclick = () => { lost = null; say("replay", { name }); button.blur(); };
      item.append(name, button);
      return item;
    }));
  },
  saved({ name, folder }) {
    $("folder").textContent = `Saved ${name} in ${folder}`;
    $("flights").open = true;
  },
  record({ on }) { $("record").checked = on; },
  error({ message }) {
    stepping = false;
    asked = null;
    if (lost) return again(); // the server's first flight cannot start, but the lost one did
    complain(message);
    notice();
  },
};

/** Begin the flight anew that was lost with its connection, flown by the same pilot if the server still offers it. */
function again() {
  const { options: same, pilot } = lost, offered = choices.pilots.includes(pilot);
  complaint = "The connection was broken, and the flight was lost. It begins again here.";
  if (pilot && !offered) complaint += ` ${pilot} cannot fly it again: choose who flies.`;
  begin(same);
  if (offered) control(pilot);
}

const hear = (told) => HEARD[told.type]?.(told);

/** Show a frame after those before it: pictures take different times to decode. */
function showInTurn(data) {
  const itsFlight = flight;
  shown = shown.then(() => show(data, itsFlight)).catch((error) => console.error(error));
}

/** Show a frame: a header's length, the header, and pictures one after another. One of an earlier flight is dropped. */
async function show(data, itsFlight) {
  const length = new DataView(data).getUint32(0, true);
  const told = JSON.parse(decoder.decode(new Uint8Array(data, 4, length)));
  let at = 4 + length;
  const pictures = {};
  for (const [kind, size] of told.pictures) {
    pictures[kind] = await createImageBitmap(new Blob([new Uint8Array(data, at, size)]));
    at += size;
  }
  say("drawn", { frame: told.frame });
  if (flight !== itsFlight) return;
  const main = told.pictures[0][0];
  paint($("view"), pictures[main]);
  $("inset").hidden = main === "mask" || !pictures.mask;
  if (!$("inset").hidden) paint($("inset"), pictures.mask);
  $("seen").hidden = !pictures.seen;
  if (pictures.seen) paint($("seen"), pictures.seen);
  $("bird").hidden = $("bird-legend").hidden = !pictures.bird;
  if (pictures.bird) paint($("bird"), pictures.bird);
  for (const picture of Object.values(pictures)) picture.close();
  $("unmapped").hidden = !told.unmapped;
  $("unmapped").textContent = told.unmapped ?? "";
  if (!latest && !told.moving && !told.ended) notice("Ready: Space flies", "W forward, A D turn, ↑ ↓ climb and descend, Q E sideways");
  latest = told;
  flies = told.flies;
  if (flies !== "hand" && choices.pilots.includes(flies)) lastPilot = flies; // not a replay
  if (asked === flies) asked = null;
  stepping = false;
  countFrame();
  if (performance.now() - drawnAt > NUMBERS_MS || !told.moving) {
    drawnAt = performance.now();
    tellNumbers(told);
    tellRate(told);
  }
}

function paint(canvas, image) {
  if (canvas.width !== image.width || canvas.height !== image.height) {
    canvas.width = image.width;
    canvas.height = image.height;
  }
  canvas.getContext("2d").drawImage(image, 0, 0);
}

function tellNumbers(told) {
  const total = Object.values(told.costs).reduce((sum, cost) => sum + cost, 0);
  $("return").textContent = told.return.toFixed(2);
  $("cost").textContent = total.toFixed(2);
  $("cost").classList.toggle("paid", total > 0);
  $("costs").textContent = Object.entries(told.costs).map(([kind, cost]) => `${kind} ${cost.toFixed(2)}`).join(" · ");
  $("progress").value = told.progress;
  $("visited").textContent = `${(100 * told.progress).toFixed(1)} %`;
  $("height").value = told.height_m;
  $("metres").textContent = `${told.height_m.toFixed(1)} m`;
  $("step").textContent = `${told.step} of ${told.max_steps}`;
  $("idle").textContent = `${told.idle} of ${told.max_idle}`;
  const [x, y, z, yaw] = told.pose;
  $("pose").textContent = `${x.toFixed(1)}, ${y.toFixed(1)}, ${z.toFixed(1)} m, ${((yaw * 180) / Math.PI).toFixed(0)}°`;
  $("wind-row").hidden = !told.wind.length;
  if (told.wind.length) $("wind").textContent = `${Math.hypot(...told.wind).toFixed(1)} m/s`;
  if ($("pilot").value !== told.flies) showPilot(told.flies);
  chart.add(told.step, told.return, total);
  chart.draw(told.max_steps);
  map.draw(told.camera, told.props);
  if (told.ended) notice(`The flight has ended: ${told.ended}`, `return ${told.return.toFixed(2)}, cost ${total.toFixed(2)}. N: next start, B: same start again`);
}

function countFrame() {
  const now = performance.now();
  shownAt = [...shownAt.filter((time) => now - time < 2000), now].slice(-RATE_FRAMES);
}

function tellRate(told) {
  const now = shownAt.at(-1);
  const rate = shownAt.length > 1 ? (1000 * (shownAt.length - 1)) / (now - shownAt[0]) : 0;
  $("rate").textContent = told.moving ? `${rate.toFixed(0)} frames/s · ${told.drawn_in_ms.toFixed(0)} ms` : "";
}

/** Who flies; one that is not on the list, such as a replay, is added while it does. */
function showPilot(name) {
  if (![...$("pilot").options].some((option) => option.value === name)) $("pilot").add(new Option(name, name));
  $("pilot").value = name;
}

function notice(title = "", text = "") {
  const box = $("notice");
  box.hidden = !title;
  const strong = document.createElement("strong");
  strong.textContent = title;
  box.replaceChildren(strong, text);
}

function complain(text) {
  $("error").textContent = text;
  $("error").hidden = !text;
}

function fill(select, names) {
  select.replaceChildren(...names.map((name) => new Option(name, name)));
}

function setForm(options) {
  form.elements.vehicle.value = options.vehicle;
  const levels = choices.levels[options.vehicle];
  fill(form.elements.level, levels.includes(options.level) ? levels : [...levels, options.level]);
  if (![...form.elements.size_px.options].some((option) => Number(option.value) === options.size_px)) {
    form.elements.size_px.add(new Option(`${options.size_px} px`, options.size_px));
  }
  for (const [name, value] of Object.entries(options)) {
    const field = form.elements[name];
    if (field.type === "checkbox") field.checked = value;
    else field.value = value ?? "";
  }
  $("task-text").textContent = choices.tasks[options.task];
}

/** The options of the form, as the server takes them. */
function options() {
  const given = Object.fromEntries(new FormData(form));
  return {
    ...given,
    hard: form.elements.hard.checked,
    seed: Number(given.seed),
    world_seed: given.world_seed === "" ? null : Number(given.world_seed),
    wind_m_per_s: Number(given.wind_m_per_s),
    size_px: Number(given.size_px),
  };
}

/** Ask for a flight. It takes the place of one that was lost. */
function begin(asked) {
  lost = null;
  say("start", { options: asked });
}

const start = (changes = {}) => begin({ ...options(), ...changes });
const restart = (by) => flight && begin({ ...flight.options, seed: flight.options.seed + by });
const view = () => ({ picture: $("picture").value, mask: $("with-mask").checked, seen: $("with-seen").checked });
const speed = () => ($("speed").value === "fastest" ? null : Number($("speed").value));
const run = (moving) => say("run", { paused: !moving, speed: speed() });

function control(name) {
  if (name !== "hand") lastPilot = name;
  flies = asked = name;
  say("control", { pilot: name });
}

/** In a paused flight, a flight key or button flies one step. */
function stepByHand() {
  if (pace.moving || stepping || latest?.ended) return;
  stepping = true;
  say("step", { action: controls.units() });
}

function cycle(select, by) {
  const count = select.options.length, next = select.selectedIndex + by;
  select.selectedIndex = select === $("speed") ? Math.max(0, Math.min(count - 1, next)) : (next + count) % count;
  select.dispatchEvent(new Event("change"));
}

const COMMANDS = {
  flight: () => stepByHand(),
  " ": () => run(!pace.moving),
  ".": () => say("step"),
  "+": () => cycle($("speed"), 1),
  "=": () => cycle($("speed"), 1),
  "-": () => cycle($("speed"), -1),
  c: () => $("cruise").click(),
  p: () => control(latest?.flies === "hand" ? lastPilot : "hand"),
  n: () => restart(1),
  b: () => restart(0),
  v: () => cycle($("picture"), 1),
  m: () => $("near").click(),
  r: () => say("save"),
};

const controls = new Controls(
  (units) => {
    say("hold", { action: units });
    const words = inWords(units, flight?.fast ? "fast forward" : "back");
    $("keys-held").replaceChildren(...words.map((word) => {
      const label = document.createElement("span");
      label.textContent = word;
      return label;
    }));
  },
  (code) => {
    const known = code in COMMANDS;
    if (known) COMMANDS[code]();
    return known;
  },
);
controls.touched = stepByHand;

$("go").onclick = () => run(!pace.moving);
$("one").onclick = () => say("step");
$("speed").onchange = () => { if (pace.moving) run(true); };
$("pilot").onchange = () => control($("pilot").value);
$("next").onclick = COMMANDS.n;
$("again").onclick = COMMANDS.b;
$("save").onclick = COMMANDS.r;
$("record").onchange = () => say("record", { on: $("record").checked });
$("cruise").onchange = () => { controls.cruise = $("cruise").checked; controls.tell(); };
$("near").onchange = () => { map.near = $("near").checked; if (latest) map.draw(latest.camera, latest.props); };
for (const id of ["picture", "with-mask", "with-seen"]) {
  $(id).onchange = () => say("view", view());
}
form.elements.vehicle.onchange = () => fill(form.elements.level, choices.levels[form.elements.vehicle.value]);
form.elements.task.onchange = () => { $("task-text").textContent = choices.tasks[form.elements.task.value]; };
form.elements.dynamics.onchange = () => {
  if (form.elements.dynamics.value === "inertial") form.elements.action.value = "continuous";
};
form.onsubmit = (event) => { event.preventDefault(); start(); };
// A button or choice that was clicked gives the keys back to the flight.
document.addEventListener("click", (event) => { if (event.target.matches("button, input[type=checkbox]")) event.target.blur(); });
document.addEventListener("change", (event) => { if (event.target.matches("select")) event.target.blur(); });
document.addEventListener("visibilitychange", () => { if (document.hidden && pace.moving) run(false); });
if (matchMedia("(max-width: 59.99rem)").matches) for (const id of ["choices", "help"]) $(id).open = false;
connect();
