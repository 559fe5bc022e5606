// The loop, the link and the recording; motors and buses on hardware; and the second figures in the 3D view.
"use strict";

const FIGURES = { reference: "motion's pose", command: "commanded pose", contacts: "contacts", follow: "camera follows" };

const fixed = (value, digits) => (value === null ? "–" : value.toFixed(digits).replace(/^-(0\.0*)$/, "$1"));

function showVitals({ rate: [rate, wanted], recording, base }) {
  const { file = "", error = null } = recording || {};
  get("recording").hidden = recording !== null && !file; // of a robot elsewhere nobody knows
  get("recording").classList.toggle("on", file !== "" && error === null);
  get("recording").classList.toggle("failed", error !== null);
  const name = file.split("/").at(-1);
  get("recording").textContent = error ? `recording stopped: ${error}` : name ? `recording ${name}` : "not recording";
  get("recording").title = file;
  get("vital-loop").textContent = `loop ${fixed(rate, 1)} of ${fixed(wanted, 0)} Hz`;
  get("vital-base").hidden = base === null;
  if (base === null) return;
  const [forward, left, turn] = base.map((value) => fixed(value, 2));
  get("vital-base").textContent = `base ${forward} m/s forward, ${left} m/s left, ${turn} rad/s turning left`;
}

// ms; null: the session has not answered.
function showLink(latency) {
  get("vital-link").textContent = `link ${fixed(latency, 0)} ms`;
}

function showMotors(hardware) {
  get("hardware").hidden = hardware === null;
  if (hardware === null) return;
  const loads = hardware.buses.map(({ name, load }) => `${name} ${load === null ? "–" : Math.round(100 * load)} %`);
  get("buses").textContent = `Bus load: ${loads.join(", ")}`;
  const body = get("motors").tBodies[0];
  hardware.motors.forEach(({ name, temperature, warning, heard, faults }, i) => {
    const row = body.rows[i] || body.insertRow();
    row.classList.toggle("faulty", faults.length > 0);
    row.classList.toggle("hot", temperature !== null && warning !== null && temperature >= warning);
    const age = heard === null ? "–" : (1000 * heard).toFixed(0);
    [name, temperature === null ? "–" : temperature.toFixed(0), age, faults.join(", ")].forEach((text, j) => {
      const cell = row.cells[j] || row.insertCell();
      if (cell.textContent !== text) cell.textContent = text;
    });
  });
}

// The switches are the same on all pages: each shows what the console says, not what was clicked here.
function showFigures(figures) {
  for (const [name, { on, why }] of Object.entries(figures)) {
    let label = document.querySelector(`#figures [data-figure="${name}"]`);
    if (!label) {
      label = document.createElement("label");
      label.dataset.figure = name;
      const box = document.createElement("input");
      box.type = "checkbox";
      box.onclick = (event) => {
        event.preventDefault();
        tell({ show: name, on: label.dataset.on !== "true" });
      };
      label.append(box, ` ${FIGURES[name]}`, document.createElement("small"));
      get("figures").append(label);
    }
    label.dataset.on = on;
    label.firstChild.checked = on;
    if (label.lastChild.textContent !== why) label.lastChild.textContent = why;
  }
}
