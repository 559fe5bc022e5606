// What a page commands beside intents: one joint by sliders, and a velocity. It sends wishes, and confirms what its
// heartbeat says; the console bounds them, decides whose they are, and stops when the heartbeat does.
"use strict";

const CONFIRM = 50; // ms between two looks at what the worker's heartbeat says
const DEAF = 500; // ms without a word from the console: who sees nothing commands nothing
const TOUCHED = 500; // ms for which a slider that was moved is not moved back
const FIELDS = [
  ["position", "position", "rad"],
  ["velocity", "velocity", "rad/s"],
  ["effort", "effort", "N·m"],
  ["stiffness", "K_p", "N·m/rad"],
  ["damping", "K_d", "N·m·s/rad"],
];
const AXES = [
  ["vx", "forward", "m/s"],
  ["vy", "left", "m/s"],
  ["wz", "turn left", "rad/s"],
];
const ARROWS = { ArrowUp: "up", ArrowDown: "down", ArrowLeft: "left", ArrowRight: "right" };

let page = 0;
let mayCommand = false;
let sent = null; // s on the console's clock, of what is shown
let turn = null; // of the sliders, as told
let number = 0; // of the turn that the sliders here began from
let goals = null;
let velocity = null; // what is known of it; null: the policy takes none
let steered = {}; // axis to what it was moved to since the last beat

function wish(what) {
  if (mayCommand) tell(what);
}

// A slider and a number field that show one value; `moved` is called with what an operator sets it to.
function makeRow(rows, key, label, unit, moved) {
  const row = document.createElement("label");
  row.className = "slider";
  const name = document.createElement("span");
  const small = document.createElement("small");
  small.textContent = unit;
  name.append(label, small);
  const range = document.createElement("input");
  const field = document.createElement("input");
  range.type = "range";
  field.type = "number";
  range.step = field.step = "any";
  range.id = `${rows.id}-${key}`;
  field.id = `${range.id}-number`;
  field.setAttribute("aria-label", `${label}, ${unit}`);
  row.append(name, range, field);
  rows.append(row);
  const parts = { range, field, touched: -Infinity };
  const set = (text) => {
    const value = Number(text);
    if (text.trim() === "" || !Number.isFinite(value)) return;
    const bounded = Math.min(Math.max(value, Number(range.min)), Number(range.max));
    parts.touched = performance.now();
    setRow(parts, bounded);
    moved(bounded);
  };
  range.addEventListener("input", () => set(range.value));
  field.addEventListener("change", () => set(field.value));
  field.addEventListener("wheel", () => field.blur()); // who scrolls the page does not mean the number below the mouse
  return parts;
}

function boundRow(parts, [low, high]) {
  for (const input of [parts.range, parts.field]) {
    input.min = low;
    input.max = high;
    input.disabled = low === high;
  }
  parts.field.step = Number(((high - low) / 200).toPrecision(1)) || "any";
}

function setRow(parts, value) {
  parts.range.value = value;
  if (document.activeElement !== parts.field || parts.touched > performance.now() - TOUCHED) {
    parts.field.value = Number(value.toFixed(3));
  }
}

const sliderRows = {};
for (const [field, label, unit] of FIELDS) {
  sliderRows[field] = makeRow(get("sliders-rows"), field, label, unit, (value) => {
    if (goals) goals[field] = value;
  });
}
const velocityRows = AXES.map(([key, label, unit], axis) =>
  makeRow(get("velocity-rows"), key, label, unit, (value) => {
    steered[axis] = value;
  }),
);

function knowCommands(told) {
  page = told.page;
  mayCommand = told.access === "control";
  sent = turn = goals = null;
  number = 0;
  steered = {};
  velocity = told.velocity;
  const options = told.joint_names.map((name) => new Option(name, name));
  get("sliders-joint").replaceChildren(...options);
  options[0].selected = true;
  get("sliders-take").disabled = told.no_sliders !== "";
  get("sliders-take").title = told.no_sliders;
  get("velocity").hidden = velocity === null;
  if (velocity === null) return;
  velocity.ranges.forEach((range, axis) => boundRow(velocityRows[axis], range));
  get("velocity-help").textContent = `${velocity.help}. Where the focus is in no text field and not in the 3D view.`;
}

const called = (n) => (n === page ? "this page" : `page ${n}`);

function showCommands(told) {
  sent = told.sent;
  turn = told.sliders;
  const isOwn = turn !== null && turn.page === page;
  get("sliders").hidden = told.mode !== "REMOTE" && turn === null;
  get("sliders-own").hidden = !isOwn;
  const owner = told.owners.REMOTE || "";
  get("sliders-text").textContent = turn
    ? `${turn.joint}: moved by ${called(turn.page)}${isOwn ? "" : ` (this is page ${page})`}`
    : [told.let_go, owner ? `REMOTE belongs to ${owner}` : "Nobody moves a joint here."].filter(Boolean).join(". ");
  if (isOwn) showOwnSliders();
  else goals = null;
  if (velocity !== null) showVelocity(told);
}

function showOwnSliders() {
  if (turn.number !== number || goals === null) {
    number = turn.number;
    goals = { ...turn.goals };
    for (const [field] of FIELDS) {
      boundRow(sliderRows[field], turn.bounds[field]);
      sliderRows[field].touched = performance.now();
      setRow(sliderRows[field], goals[field]);
    }
  }
  const shown = (value, digits) => (value === null ? "–" : value.toFixed(digits));
  const { position, velocity, effort, stiffness, damping } = turn.command;
  get("sliders-measured").textContent =
    `is at ${shown(turn.measured, 3)} rad; commanded: ${shown(position, 3)} rad, ${shown(velocity, 2)} rad/s, ` +
    `${shown(effort, 2)} N·m, K_p ${shown(stiffness, 1)}, K_d ${shown(damping, 2)}`;
}

function showVelocity(told) {
  const steering = told.steering;
  const isOwn = steering.page === page;
  const owner = told.owners.velocity || "";
  const by = steering.page === null ? owner : `${owner || "console"}, ${called(steering.page)}`;
  const texts = AXES.map(([, label, unit], axis) => `${label} ${steering.present[axis].toFixed(2)} ${unit}`);
  get("velocity-text").textContent = `${texts.join(", ")}${by ? ` by ${by}` : ""}`;
  const shown = isOwn ? steering.wanted : steering.present;
  const now = performance.now();
  velocityRows.forEach((row, axis) => {
    if (now - row.touched > TOUCHED) setRow(row, shown[axis]);
  });
}

function letGo() {
  steered = {};
  socket.beat(null);
  wish({ do: "let_go" });
}

function confirmBeat() {
  if (document.visibilityState !== "visible" || performance.now() - heard > DEAF || sent === null || !mayCommand) {
    socket.beat(null);
    return;
  }
  for (const [axis, value] of Object.entries(steered)) wish({ do: "steer", axis: Number(axis), value });
  steered = {};
  socket.beat(JSON.stringify({ do: "beat", seen: sent, number, goals }));
}

// Velocity keys work wherever they mean nothing else.
function onVelocityKey(event) {
  const key = ARROWS[event.key] || event.key;
  if (velocity === null || !mayCommand || !velocity.keys.includes(key)) return;
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  const { tagName, type } = event.target;
  if (tagName === "SELECT" || (tagName === "INPUT" && (type !== "range" || key !== event.key))) return;
  event.preventDefault();
  velocityRows.forEach((row) => (row.touched = -Infinity));
  wish({ do: "press", key });
}

get("sliders-take").addEventListener("click", () => wish({ do: "take", joint: get("sliders-joint").value }));
get("sliders-snap").addEventListener("click", () => wish({ do: "snap" }));
get("sliders-let-go").addEventListener("click", letGo);
get("velocity-stop").addEventListener("click", () => {
  steered = {};
  velocityRows.forEach((row) => (row.touched = -Infinity));
  wish({ do: "press", key: "0" });
});
window.addEventListener("keydown", onVelocityKey);
window.addEventListener("pagehide", letGo);
document.addEventListener("visibilitychange", () => {
  if (document.visibilityState !== "visible") letGo();
});
setInterval(confirmBeat, CONFIRM);
