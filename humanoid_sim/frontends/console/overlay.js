// The operator's overlay upon viser's page: DAMP, the mode, and a cover where what is shown is not the present. It sends
// DAMP, by button or space bar wherever the focus is, presses, and heartbeats that say how new what it shows is.
"use strict";

(() => {
  const SILENCE = 1000; // ms without a word from the console: from then on nothing that is shown may be true
  const OLD = 0.5; // s that the session's newest tick may be old
  const BEAT = 50; // ms
  const MODES = { DAMPING: "#6d4a00", STANDBY: "#14507a", LOCOMOTION: "#17672f", REMOTE: "#5b2a83" };
  const base = location.href.split("?")[0].replace(/^http/, "ws");
  history.replaceState(null, "", `?websocket=${base}viser`); // viser connects there

  const STYLE = `
    #operator { position: fixed; top: 0.6rem; left: 50%; translate: -50% 0; z-index: 1000; width: min(24rem, calc(100vw - 1.2rem)); font: 15px/1.35 system-ui, sans-serif; color: #eee; }
    #operator > * { border-radius: 6px; margin-bottom: 0.3rem; padding: 0.2rem 0.5rem; text-align: center; overflow-wrap: anywhere; }
    #damp { width: 100%; font: bold 1.4rem system-ui, sans-serif; color: inherit; background: #b3261e; border: 1px solid #ff8f87; cursor: pointer; min-height: 3rem; }
    #mode { font-size: 1.6rem; font-weight: bold; background: #3a3f45; }
    #reason { background: rgb(22 25 29 / 0.8); }
    #cover { position: fixed; inset: 0; z-index: 1001; display: flex; flex-direction: column; align-items: center; justify-content: center; text-align: center; padding: 1rem; background: rgb(120 10 10 / 0.93); color: #fff; font: 1.3rem system-ui, sans-serif; }
    #cover[hidden] { display: none; }
    #cover strong { font-size: 3rem; }`;
  const BODY = `
    <div id="operator"><button id="damp">DAMP <small>space bar</small></button>
    <div id="mode" data-mode=""></div><div id="reason"></div></div>
    <div id="cover" role="alert"><strong id="cover-title">NO CONNECTION</strong><p id="cover-text"></p></div>`;
  const get = (id) => document.getElementById(id);
  let received = -Infinity;
  let facts = { age: 0 };

  // The connection and the heartbeat are on a thread of their own, which drawing the 3D view does not delay. A beat
  // names the newest tick that the page's thread has shown: where that one stands still, the beats grow old.
  function work(url, period) {
    let socket = null;
    let seen = null;
    const send = (text) => socket.readyState === WebSocket.OPEN && socket.send(text);
    const connect = () => {
      socket = new WebSocket(url);
      socket.onmessage = ({ data }) => postMessage(data);
      socket.onclose = () => {
        seen = null;
        postMessage(null);
        setTimeout(connect, 500);
      };
    };
    onmessage = ({ data }) => (data === "damp" || data === "hand" ? send(data) : (seen = data));
    setInterval(() => seen && send(seen), period);
    connect();
  }

  const code = `(${work})(${JSON.stringify(`${base}console`)}, ${BEAT})`;
  const link = new Worker(URL.createObjectURL(new Blob([code])));
  link.onmessage = ({ data }) => {
    received = data === null ? -Infinity : performance.now();
    if (data !== null) facts = JSON.parse(data);
    show();
    if (facts.ended) link.terminate();
  };
  const damp = () => link.postMessage("damp");

  function show() {
    if (document.hidden || !get("damp")) return;
    const mode = facts.mode || "";
    get("damp").hidden = !facts.control;
    get("mode").textContent = get("mode").dataset.mode = mode;
    get("mode").style.background = MODES[mode] || "";
    get("reason").textContent = facts.reason || "";
    if (facts.stamp) link.postMessage(facts.stamp);
  }

  // What is shown is true only while the console speaks and the session ticks.
  function cover() {
    const silent = performance.now() - received > SILENCE;
    const old = facts.age > OLD;
    get("cover").hidden = !(facts.ended || silent || old);
    get("cover-title").textContent = facts.ended ? "THE SESSION HAS ENDED" : silent ? "NO CONNECTION" : "THE SESSION STANDS STILL";
    get("cover-text").textContent = facts.ended
      ? ""
      : silent
        ? "What you press here does nothing. What is behind this is the past. Use another way to damp the robot."
        : `Its newest tick is ${facts.age.toFixed(1)} s old. The space bar still sends DAMP.`;
  }

  function onSpace(event) {
    if (event.code !== "Space") return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (event.type === "keydown" && !event.repeat) damp();
  }

  // Whoever only turns the camera commands nothing.
  const onPress = ({ target }) => target !== document.body && target.tagName !== "CANVAS" && link.postMessage("hand");
  for (const type of ["pointerdown", "keydown"]) window.addEventListener(type, onPress, true);
  for (const type of ["keydown", "keyup", "keypress"]) window.addEventListener(type, onSpace, true);
  document.addEventListener("DOMContentLoaded", () => {
    document.head.insertAdjacentHTML("beforeend", `<style>${STYLE}</style>`);
    document.body.insertAdjacentHTML("beforeend", BODY);
    get("damp").addEventListener("click", damp);
    setInterval(cover, 100);
  });
})();
