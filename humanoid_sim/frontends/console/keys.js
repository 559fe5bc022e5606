// A piano's keys, lit as they are pressed: as the song asks, missing, or wrong.
"use strict";

const KEYS = 88;
const BLACK = new Set([1, 3, 6, 8, 10]); // of an octave, from C
const NAMES = ["C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B"];

function buildKeys() {
  let white = null;
  for (let i = 0; i < KEYS; i++) {
    const note = i + 21;
    const key = document.createElement("div");
    key.dataset.key = i;
    key.title = `${NAMES[note % 12]}${Math.floor(note / 12) - 1}`;
    if (BLACK.has(note % 12)) {
      key.className = "black";
      white.append(key); // over the edge of the white key on its left
    } else {
      white = key;
      get("keys-row").append(key);
    }
  }
}

// Where nobody knows which keys are down, none is lit as pressed, and it says so.
function showKeys(keys) {
  get("keys").hidden = keys === null;
  if (keys === null) return;
  if (!get("keys-row").childElementCount) buildKeys();
  const down = new Set(keys.down || []);
  const wanted = new Set(keys.wanted || []);
  const text = keys.down === null ? "which keys are down is not known" : keys.wanted === null ? "no song is played" : "";
  if (get("keys-text").textContent !== text) get("keys-text").textContent = text;
  for (const key of document.querySelectorAll("#keys-row [data-key]")) {
    const i = Number(key.dataset.key);
    let state = "";
    if (down.has(i)) state = keys.wanted === null ? "down" : wanted.has(i) ? "hit" : "wrong";
    else if (wanted.has(i)) state = "wanted";
    if (key.dataset.state !== state) key.dataset.state = state;
  }
}
