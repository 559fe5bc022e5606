// The operator's page. It decides nothing: it shows what the session says, and asks.
"use strict";

const SILENCE = 1000; // ms without a word from the console: from then on nothing that is shown may be true
const OLD = 0.5; // s that the session's newest tick may be old
const CONFIRMED = 5000; // ms within which REACTIVATE is pressed again
const MOST_EVENTS = 200;

const get = (id) => document.getElementById(id);
let link = null; // a worker, which holds the connection
const socket = {
  isOpen: false,
  send: (text) => link.postMessage({ send: text }),
  beat: (text) => link && link.postMessage({ beat: text }), // again and again, until told otherwise
  close: () => link.postMessage({ close: true }),
};
let heard = -Infinity;
let age = 0;
let seen = null; // s on the console's clock, when the newest tick that is shown was so
let ended = false;
let jointNames = [];
let armed = -Infinity; // when REACTIVATE was pressed first
let marking = false; // an answer to a mark is awaited

// Of what is not an intent; without a connection nothing is sent.
function tell(message) {
  if (socket.isOpen) socket.send(JSON.stringify(message));
  return socket.isOpen;
}

function ask(word) {
  marking = marking || word === "mark";
  if (word === "mark") get("mark-answer").textContent = "marking …";
  if (!tell({ ask: word, seen })) showAnswer({ granted: false, text: `${word}: not sent, there is no connection` });
}

function connect() {
  link = new Worker("link.js");
  link.onmessage = hear;
}

function hear({ data }) {
  if (data.open !== undefined) {
    socket.isOpen = data.open;
    if (!data.open) heard = -Infinity;
  } else if (data.latency !== undefined) {
    showLink(data.latency);
  } else {
    heard = performance.now();
    if (data instanceof ArrayBuffer) plots.take(data);
    else show(JSON.parse(data));
  }
  if (ended) link.terminate();
  cover();
}

function show(told) {
  if (told.ended) ended = true;
  if (told.session) {
    get("session").textContent = told.session + (told.access === "control" ? "" : ", for watching only");
    document.body.dataset.access = told.access;
    knowCommands(told);
    get("policy-text").textContent = told.policy || "none";
    jointNames = told.joint_names;
    plots.begin(told.robot, told.charts);
    get("events").replaceChildren(); // of before a new connection: the console tells them all again
  }
  if (told.mode === undefined) return;
  age = told.age;
  seen = told.stamp;
  get("mode").textContent = told.fallen ? `FALLEN · ${told.mode}` : told.mode;
  get("mode").dataset.mode = told.mode;
  get("mode").classList.toggle("fallen", told.fallen !== "");
  get("reason").textContent = told.reason || told.controller;
  showStop(told);
  get("clock").textContent = `${told.time.toFixed(1)} s`;
  showVitals(told.vitals);
  showStandby(told.standby);
  showIntents(told.intents);
  showSafety(told.safety, told.fallen);
  showJoints(told.joints);
  showCommands(told);
  showMotors(told.hardware);
  showFigures(told.figures);
  showKeys(told.keys);
  showSimulation(told.simulation || null);
  const owners = Object.entries(told.owners).filter(([, who]) => who).map(([what, who]) => `${what}: ${who}`);
  get("owners").textContent = owners.length ? `Driven by ${owners.join(", ")}` : "";
  for (const answer of told.answers) showAnswer(answer);
  for (const [, time, text] of told.events) {
    const line = document.createElement("li");
    line.textContent = `${time.toFixed(2)} s  ${text}`;
    line.dataset.time = time;
    insertEvent(line, time);
  }
  while (get("events").childElementCount > MOST_EVENTS) get("events").lastChild.remove();
}

// The newest on top: an event may be told before a tick that is older.
function insertEvent(line, time) {
  let below = get("events").firstChild;
  while (below && Number(below.dataset.time) > time) below = below.nextSibling;
  get("events").insertBefore(line, below);
}

// Why the robot does not do any more what somebody commanded, until somebody commands anew.
function showStop({ mode, fallen, let_go, lost }) {
  const silent = Object.entries(lost).map(([what, who]) => `${what}: ${who} fell silent`);
  const stopped = mode === "LOCOMOTION" || mode === "REMOTE" ? (let_go ? [let_go] : silent) : [];
  const text = [fallen && `the robot ${fallen}`, ...stopped].filter(Boolean).join("; ");
  if (get("stop").textContent !== text) get("stop").textContent = text;
}

function showStandby(standby) {
  get("standby").hidden = standby === null;
  if (standby === null) return;
  const { segment, segments, progress, finished } = standby;
  get("done").style.width = `${(100 * (finished ? segments : segment - 1 + progress)) / segments}%`;
  get("standby-text").textContent = finished ? "pose reached" : `pose ${segment} of ${segments}`;
}

function showIntents(intents) {
  for (const [word, { name, refusal, why, note }] of Object.entries(intents)) {
    if (word === "damp") continue; // it has its place, and is never dimmed
    let button = document.querySelector(`:is(#intents, #apart) [data-ask="${word}"]`);
    if (!button) {
      button = document.createElement("button");
      button.dataset.ask = word;
      button.append(name, document.createElement("small"));
      get(word === "reactivate" ? "apart" : "intents").append(button);
    }
    const isArmed = word === "reactivate" && performance.now() - armed < CONFIRMED;
    const requirement = isArmed ? "press again to confirm" : why || note || "";
    button.classList.toggle("armed", isArmed);
    button.classList.toggle("refused", refusal !== "");
    button.title = refusal;
    if (button.lastChild.textContent !== requirement) button.lastChild.textContent = requirement;
  }
}

// What is not known, such as the position of a joint that has not been heard, is a dash.
function showJoints({ position, command, velocity, effort }) {
  const body = get("joints").tBodies[0];
  jointNames.forEach((name, i) => {
    const row = body.rows[i] || body.insertRow();
    const texts = [name, ...[position, command, velocity, effort].map((v) => (v[i] === null ? "–" : v[i].toFixed(2)))];
    texts.forEach((text, j) => {
      const cell = row.cells[j] || row.insertCell();
      if (cell.textContent !== text) cell.textContent = text;
    });
  });
}

function showSafety(statuses, fallen) {
  const fall = fallen ? [{ level: "FALLEN", source: "the robot", flags: [], message: fallen }] : [];
  const lines = [...fall, ...statuses].map(({ level, source, flags, message }) => {
    const line = document.createElement("li");
    line.dataset.level = level;
    line.textContent = [level, source, message].filter(Boolean).join(" · ");
    for (const flag of flags) {
      const small = document.createElement("small");
      small.textContent = flag;
      line.append(small);
    }
    return line;
  });
  if (!lines.length) {
    const line = document.createElement("li");
    line.dataset.level = "OK";
    line.textContent = "OK";
    lines.push(line);
  }
  get("safety").replaceChildren(...lines);
}

function showAnswer({ granted, text }) {
  let place = "answer"; // of a mark beside its button, and only there
  if (marking && /mark/.test(text)) {
    place = "mark-answer";
    marking = false;
  }
  get(place).classList.toggle("refused", !granted);
  get(place).textContent = text;
}

// What is shown is true only while the console speaks and the session ticks.
function cover() {
  const silent = performance.now() - heard > SILENCE;
  const old = age > OLD;
  get("cover").hidden = !(ended || silent || old);
  get("cover-title").textContent = ended ? "THE SESSION HAS ENDED" : silent ? "NO CONNECTION" : "THE SESSION STANDS STILL";
  get("cover-text").textContent = ended
    ? ""
    : silent
      ? "What you press here does nothing. What is behind this is the past. Use another way to damp the robot."
      : `Its newest tick is ${age.toFixed(1)} s old. DAMP is still sent.`;
}

// The space bar damps wherever the focus is, in the 3D view too, and does nothing else.
function onKey(event) {
  if (event.code !== "Space") return;
  event.preventDefault();
  event.stopImmediatePropagation();
  if (event.type === "keydown" && !event.repeat) ask("damp");
}

function listen(target) {
  for (const type of ["keydown", "keyup", "keypress"]) target.addEventListener(type, onKey, true);
}

listen(window);
// REACTIVATE is asked for twice; a double click is not twice. A dialog of the browser would stop heartbeat and space bar.
function isConfirmed(clicks) {
  if (clicks > 1) return false;
  const wasArmed = performance.now() - armed < CONFIRMED;
  armed = wasArmed ? -Infinity : performance.now();
  return wasArmed;
}

const view = get("view");
const listenInView = () => {
  try {
    listen(view.contentWindow);
  } catch {
    // A view that could not be loaded is the browser's own page, which is another origin, and has no keys to hear.
  }
};
const prepareView = () => {
  listenInView();
  const style = document.createElement("style"); // viser's own panel has nothing for an operator
  style.textContent = "[data-floating-window] { display: none !important; }";
  view.contentDocument?.head?.append(style);
};
view.addEventListener("load", prepareView);
prepareView(); // where it was loaded before this script ran
document.addEventListener("click", (event) => {
  const button = event.target.closest("[data-ask]");
  if (button && (button.dataset.ask !== "reactivate" || isConfirmed(event.detail))) ask(button.dataset.ask);
});
setInterval(cover, 100);
document.addEventListener("DOMContentLoaded", connect); // not before every script of the page has run
