// The page's connection and its heartbeat, on a thread of their own (a worker), which drawing the 3D view does not delay.
// A beat says what the page's own thread has confirmed, and how new that was: where that thread stands still, the
// beats grow old, and the console lets go.
"use strict";

const BEAT = 50; // ms
const PING = 1000; // ms between two measurements of the way to the session and back
let socket = null;
let pings = 0;
let pinged = null; // when the newest ping left; null: it was answered
let beat = null; // as the page confirmed it last; null: it commands nothing

function connect() {
  socket = new WebSocket(new URL("console", location.href.replace(/^http/, "ws")));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => postMessage({ open: true });
  socket.onmessage = ({ data }) => {
    if (data instanceof ArrayBuffer || !data.startsWith('{"pong"')) {
      postMessage(data, data instanceof ArrayBuffer ? [data] : []);
    } else if (JSON.parse(data).pong === pings && pinged !== null) {
      postMessage({ latency: performance.now() - pinged });
      pinged = null;
    }
  };
  socket.onclose = () => {
    beat = null;
    postMessage({ open: false });
    setTimeout(connect, 500);
  };
}

function send(text) {
  if (socket.readyState === WebSocket.OPEN) socket.send(text);
}

onmessage = ({ data }) => {
  if ("send" in data) send(data.send);
  if ("beat" in data) beat = data.beat;
  if ("close" in data) socket.close();
};
setInterval(() => {
  if (pinged !== null) postMessage({ latency: null });
  pinged = performance.now();
  send(JSON.stringify({ ping: ++pings }));
}, PING);
setInterval(() => beat !== null && send(beat), BEAT);
connect();
