// Live plots, drawn by Plotly, of what the operator chose. The console sends rows of the charts that are chosen here.
"use strict";

const plots = (() => {
  const MOST = 8; // plots at once
  const MOST_CHARTS = 24; // in all of them, as the console allows
  const KEPT = 600; // s that the page keeps
  const REDRAW = 100; // ms
  const HEIGHT = 150;
  const LONGEST_COOKIE = 3000; // characters: browsers and servers take 4096
  const COLORS = ["#4aa3e0", "#ffaa3c", "#59c36a", "#ff5449", "#b58cf0", "#5fd3c9", "#f0e15a", "#e88ac2", "#9aa4ae", "#c08a5a"];
  const get = (id) => document.getElementById(id);
  let robot = null;
  let charts = new Map(); // by key: { number, group, title, unit, series }, as the console has them
  let layout = []; // each plot is a list of keys; of some there may be nothing at present, as without a policy
  let shown = []; // { entry of the layout, keys, figure, host, isChanged, isDrawn }
  const live = new Map(); // by key: columns, the first are the times
  let end = null; // s, the end of what is shown, while the plots are frozen
  let held = new Map(); // as `live` was then: nothing replaces what somebody looks at
  let library = null; // Plotly is large: it comes with the first plot, and keeps nothing waiting
  let turn = 0; // whose turn it is to be drawn

  // In a cookie, which all ports of a host share: each session's page has a port of its own, and storage does not.
  function stored() {
    try {
      return JSON.parse(decodeURIComponent(document.cookie.match(/(?:^|; )plots=([^;]*)/)[1]));
    } catch {
      return {};
    }
  }

  function store() {
    const { [robot]: _, ...others } = stored();
    const kept = [[robot, layout], ...Object.entries(others)];
    const text = () => encodeURIComponent(JSON.stringify(Object.fromEntries(kept)));
    while (text().length > LONGEST_COOKIE) kept.pop(); // the robot that was not looked at for longest
    document.cookie = `plots=${text()}; path=/; max-age=31536000; SameSite=Strict`;
  }

  // A new connection: what there is, and again what is wanted.
  function begin(name, told) {
    if (name !== robot) layout = [stored()[name] || []].flat();
    robot = name;
    charts = new Map(
      told.map(([group, title, unit, series], number) => [`${group}: ${title}`, { number, group, title, unit, series }]),
    );
    live.clear();
    offer(get("add-plot"));
    for (const { figure } of shown) offer(figure.querySelector("select"));
    arrange(layout.filter(Array.isArray).slice(0, MOST));
  }

  function offer(select) {
    select.replaceChildren(select.firstElementChild);
    const groups = new Map();
    for (const [key, { group, title }] of charts) {
      if (!groups.has(group)) {
        groups.set(group, document.createElement("optgroup"));
        groups.get(group).label = group;
        select.append(groups.get(group));
      }
      groups.get(group).append(new Option(title, key));
    }
  }

  function arrange(entries) {
    layout = entries.filter((entry) => entry.length);
    store();
    const before = new Map(shown.map((drawn) => [drawn.figure.dataset.plot, drawn]));
    shown = [];
    for (const entry of layout) {
      const keys = entry.filter((key) => charts.has(key));
      const name = keys.join(" + ");
      if (keys.length) shown.push(Object.assign(before.get(name) || make(keys, name), { entry, isChanged: true }));
      before.delete(name);
    }
    for (const { host, isDrawn } of before.values()) if (isDrawn) Plotly.purge(host);
    get("charts").replaceChildren(...shown.map(({ figure }) => figure));
    const wanted = [...new Set(shown.flatMap(({ keys }) => keys))].slice(0, MOST_CHARTS);
    for (const key of live.keys()) if (!wanted.includes(key)) live.delete(key);
    for (const key of wanted) if (!live.has(key)) live.set(key, [[], ...charts.get(key).series.map(() => [])]);
    get("plots").classList.toggle("empty", !shown.length);
    get("add-plot").disabled = shown.length >= MOST;
    tell({ plot: wanted.map((key) => charts.get(key).number) });
  }

  function make(keys, name) {
    const figure = document.createElement("figure");
    figure.dataset.plot = name;
    const caption = document.createElement("figcaption");
    const host = document.createElement("div");
    const drawn = { keys, figure, host, isDrawn: false };
    const change = (entry) => arrange(layout.map((other) => (other === drawn.entry ? entry : other)));
    for (const key of keys) {
      const { group, title, unit } = charts.get(key);
      const part = document.createElement("span");
      const close = document.createElement("button");
      close.textContent = "×";
      close.setAttribute("aria-label", `remove ${key} from the plot`);
      close.onclick = () => change(drawn.entry.filter((other) => other !== key));
      part.append(`${title}: ${group}, ${unit}`, close);
      caption.append(part);
    }
    const more = document.createElement("select");
    more.setAttribute("aria-label", `add to the plot ${name}`);
    more.append(new Option("add …", ""));
    offer(more);
    more.onchange = () => {
      const key = more.value;
      more.value = "";
      if (!keys.includes(key) && (live.has(key) || live.size < MOST_CHARTS)) change([...drawn.entry, key]);
    };
    caption.append(more);
    figure.append(caption, host);
    load();
    return drawn;
  }

  function load() {
    if (library !== null) return;
    library = document.createElement("script");
    library.src = "plotly.js";
    document.head.append(library);
  }

  const columnsOf = (key) => (end !== null && held.get(key)) || live.get(key) || [[]];

  // Of all that is plotted: the first time and the last, s.
  function known() {
    const all = shown.flatMap(({ keys }) => keys.map((key) => columnsOf(key)[0])).filter((times) => times.length);
    return all.length ? [Math.min(...all.map((times) => times[0])), Math.max(...all.map((times) => times.at(-1)))] : [0, 0];
  }

  function range() {
    const [first, last] = known();
    const to = end === null ? last : end;
    return [Math.max(first, to - Number(get("plots-span").value)), to];
  }

  function draw(drawn) {
    const { keys, host } = drawn;
    const [from, to] = range();
    const units = [...new Set(keys.map((key) => charts.get(key).unit))]; // each has an axis, the first one on the left
    const isOne = new Set(keys.map((key) => charts.get(key).title)).size === 1; // what all are of stands in the caption
    const traces = keys.flatMap((key) => {
      const { title, unit, series } = charts.get(key);
      const [times, ...columns] = columnsOf(key);
      const first = times.findIndex((time) => time >= from);
      const after = times.findIndex((time) => time > to);
      const part = (column) => (first < 0 ? [] : column.slice(first, after < 0 ? undefined : after));
      const axis = units.indexOf(unit);
      return series.map((name, i) => ({
        x: part(times),
        y: part(columns[i] || []),
        name: isOne ? name : `${title}: ${name}`,
        mode: "lines",
        yaxis: axis ? `y${axis + 1}` : "y",
      }));
    });
    traces.forEach((trace, i) => {
      trace.line = { color: COLORS[i % COLORS.length], width: 1.5, dash: i >= COLORS.length ? "dash" : "solid" };
    });
    const axis = { gridcolor: "#2b3036", zeroline: false };
    const layout = {
      width: drawn.figure.clientWidth,
      height: HEIGHT + (traces.length > 1 ? 18 * Math.ceil(traces.length / (isOne ? 3 : 2)) : 0),
      margin: { l: 56, r: 8, t: 6, b: 24 },
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: "#99a1a9", size: 11, family: "system-ui" },
      xaxis: { ...axis, range: [from, to] },
      yaxis: axis,
      showlegend: traces.length > 1,
      legend: { orientation: "h", y: 1, yanchor: "bottom" },
      hovermode: "x unified",
      hoverlabel: { bgcolor: "#16191d" },
      dragmode: false,
    };
    if (units.length > 1) layout.yaxis = { ...axis, title: { text: units[0], standoff: 2 } };
    units.slice(1).forEach((unit, i) => {
      const place = { overlaying: "y", side: "right", anchor: "free", autoshift: true, tickmode: "auto", showgrid: false };
      layout[`yaxis${i + 2}`] = { ...axis, ...place, title: { text: unit, standoff: 2 } };
    });
    Plotly.react(host, traces, layout, { staticPlot: end === null, displayModeBar: false });
    drawn.isChanged = false;
    drawn.isDrawn = true;
  }

  // Rows of a chart: its number, how many, whether they replace what is here; the times, and each series.
  function take(buffer) {
    const [number, count, isWhole] = new Float64Array(buffer, 0, 3);
    const key = [...charts.keys()][number];
    if (!live.has(key)) return;
    const values = new Float64Array(buffer, 24);
    let columns = live.get(key);
    const rows = columns.map((_, i) =>
      Array.from(values.subarray(i * count, (i + 1) * count), (value) => (Number.isFinite(value) ? value : null)),
    );
    if (isWhole) columns = rows;
    else rows.forEach((row, i) => columns[i].push(...row));
    const oldest = columns[0].at(-1) - KEPT;
    if (columns[0][0] < oldest) {
      const first = columns[0].findIndex((time) => time >= oldest + 0.1 * KEPT);
      columns = columns.map((column) => column.slice(first));
    }
    live.set(key, columns);
    if (isWhole || end === null) for (const drawn of shown) drawn.isChanged ||= drawn.keys.includes(key);
  }

  // Show what was until this time, s; null: the present again.
  function look(until) {
    if (end === null) held = new Map(live);
    end = until;
    if (end === null) held.clear();
    for (const drawn of shown) drawn.isChanged = true;
    showTime();
  }

  function showTime() {
    const [first, last] = known();
    const [from, to] = range();
    const slider = get("plots-time");
    slider.min = first;
    slider.max = last;
    slider.value = to;
    get("plots-shown").textContent = `${end === null ? "" : "frozen: "}${from.toFixed(1)} to ${to.toFixed(1)} s`;
    get("plots-pause").textContent = end === null ? "Freeze" : "Live";
    get("plots").classList.toggle("paused", end !== null);
  }

  // One plot at a time, so that the page answers between two of them; one in the background draws nothing.
  setInterval(() => {
    if (document.hidden || !shown.length) return;
    showTime();
    if (!("Plotly" in window)) return;
    for (let i = 0; i < shown.length; i++) {
      const drawn = shown[(turn + i) % shown.length];
      if (!drawn.isChanged || !drawn.figure.clientWidth) continue;
      turn = (turn + i + 1) % shown.length;
      draw(drawn);
      return;
    }
  }, REDRAW);
  get("add-plot").onchange = (event) => {
    if (event.target.value && live.size < MOST_CHARTS) arrange([...layout, [event.target.value]]);
    event.target.value = "";
  };
  get("plots-pause").onclick = () => look(end === null ? known()[1] : null);
  get("plots-time").oninput = (event) => look(Number(event.target.value));
  get("plots-span").onchange = () => look(end);
  window.addEventListener("resize", () => shown.forEach((drawn) => (drawn.isChanged = true)));
  get("plots").classList.add("empty");
  return { begin, take };
})();
