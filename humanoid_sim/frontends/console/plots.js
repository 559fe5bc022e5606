// Live plots, drawn by Plotly, of what the operator chose. The console sends rows of the charts that are chosen here.
"use strict";

const plots = (() => {
  const MOST = 8; // charts at once, as the console allows
  const SPAN = 60; // s that a chart shows
  const REDRAW = 100; // ms
  const HEIGHT = 150;
  const COLORS = ["#4aa3e0", "#ffaa3c", "#59c36a", "#ff5449", "#b58cf0", "#5fd3c9", "#f0e15a", "#e88ac2", "#9aa4ae", "#c08a5a"];
  const get = (id) => document.getElementById(id);
  const shown = new Map(); // by key: { figure, host, series, data, isChanged, isDrawn }
  let charts = []; // [group, name, unit, series], as the console has them
  let wanted = JSON.parse(sessionStorage.getItem("plots") || "[]"); // keys; kept while the tab lives

  let library = null; // Plotly is large: it comes with the first plot, and keeps nothing waiting
  let turn = 0; // whose turn it is to be drawn

  const key = ([group, name]) => `${group}: ${name}`;

  // A new connection: what there is, and again what is wanted.
  function begin(told) {
    charts = told;
    const select = get("add-plot");
    select.replaceChildren(select.firstElementChild);
    const groups = new Map();
    for (const chart of charts) {
      if (!groups.has(chart[0])) {
        const group = document.createElement("optgroup");
        group.label = chart[0];
        groups.set(chart[0], group);
        select.append(group);
      }
      groups.get(chart[0]).append(new Option(chart[1], key(chart)));
    }
    for (const name of shown.keys()) remove(name);
    choose(wanted.filter((name) => charts.some((chart) => key(chart) === name)).slice(0, MOST));
  }

  function choose(keys) {
    wanted = keys;
    sessionStorage.setItem("plots", JSON.stringify(wanted));
    for (const name of shown.keys()) if (!wanted.includes(name)) remove(name);
    for (const name of wanted) if (!shown.has(name)) add(name);
    get("plots").classList.toggle("empty", wanted.length === 0);
    get("add-plot").disabled = wanted.length >= MOST;
    tell({ plot: wanted.map((name) => charts.findIndex((chart) => key(chart) === name)) });
  }

  function add(name) {
    const [group, title, unit, series] = charts.find((chart) => key(chart) === name);
    const figure = document.createElement("figure");
    figure.dataset.plot = name;
    const caption = document.createElement("figcaption");
    const close = document.createElement("button");
    close.textContent = "×";
    close.setAttribute("aria-label", `remove the plot ${name}`);
    close.onclick = () => choose(wanted.filter((other) => other !== name));
    caption.append(`${title}: ${group}, ${unit}`, close);
    figure.append(caption);
    get("charts").append(figure);
    const host = document.createElement("div");
    figure.append(host);
    shown.set(name, { figure, host, series, data: [[], ...series.map(() => [])], isChanged: true, isDrawn: false });
    load();
  }

  function load() {
    if (library !== null) return;
    library = document.createElement("script");
    library.src = "plotly.js";
    document.head.append(library);
  }

  function draw(drawn) {
    const { host, series, data } = drawn;
    const traces = series.map((name, i) => ({
      x: data[0],
      y: data[i + 1],
      name,
      mode: "lines",
      line: { color: COLORS[i % COLORS.length], width: 1.5, dash: i >= COLORS.length ? "dash" : "solid" },
    }));
    const axis = { gridcolor: "#2b3036", zeroline: false };
    const layout = {
      width: drawn.figure.clientWidth,
      height: HEIGHT + (series.length > 1 ? 18 * Math.ceil(series.length / 3) : 0),
      margin: { l: 56, r: 8, t: 6, b: 24 },
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: "#99a1a9", size: 11, family: "system-ui" },
      xaxis: axis,
      yaxis: axis,
      showlegend: series.length > 1,
      legend: { orientation: "h", y: 1, yanchor: "bottom" },
    };
    Plotly.react(host, traces, layout, { staticPlot: true });
    drawn.isChanged = false;
    drawn.isDrawn = true;
  }

  function remove(name) {
    const { figure, host, isDrawn } = shown.get(name);
    shown.delete(name);
    if (isDrawn) Plotly.purge(host);
    figure.remove();
  }

  // Rows of a chart: its number, how many, whether they replace what is here; the times, and each series.
  function take(buffer) {
    const [chart, count, isWhole] = new Float64Array(buffer, 0, 3);
    const drawn = charts[chart] && shown.get(key(charts[chart]));
    if (!drawn) return;
    const values = new Float64Array(buffer, 24);
    const last = count > 0 ? values[count - 1] : 0;
    drawn.data = drawn.data.map((old, i) => {
      const rows = Array.from(values.subarray(i * count, (i + 1) * count), (value) => (Number.isFinite(value) ? value : null));
      return isWhole ? rows : old.concat(rows);
    });
    const first = drawn.data[0].findIndex((time) => time >= last - SPAN);
    drawn.data = drawn.data.map((column) => column.slice(first));
    drawn.isChanged = true;
  }

  // One plot at a time, so that the page answers between two of them; one in the background draws nothing.
  setInterval(() => {
    if (document.hidden || !("Plotly" in window)) return;
    const all = [...shown.values()];
    for (let i = 0; i < all.length; i++) {
      const drawn = all[(turn + i) % all.length];
      if (!drawn.isChanged || !drawn.figure.clientWidth) continue;
      turn = (turn + i + 1) % all.length;
      draw(drawn);
      return;
    }
  }, REDRAW);
  get("add-plot").onchange = (event) => {
    if (event.target.value && !wanted.includes(event.target.value)) choose([...wanted, event.target.value]);
    event.target.value = "";
  };
  get("plots").classList.add("empty");
  return { begin, take };
})();
