// The page's connection and its heartbeat, on a thread of their own (a worker), which drawing the 3D view does not delay.
// A beat says what the page's own thread has confirmed, and how new that was: where that thread stands still, the
// beats grow old, and the console lets go.
"use strict";

const BEAT = 50; // ms
let socket = null;
let beat = null; // as the page confirmed it last; null: it commands nothing

function connect() {
  socket = new WebSocket(new URL("console", location.href.replace(/^http/, "ws")));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => postMessage({ open: true });
  socket.onmessage = ({ data }) => postMessage(data, data instanceof ArrayBuffer ? [data] : []);
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
setInterval(() => beat !== null && send(beat), BEAT);
connect();
