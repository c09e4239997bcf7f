// The WebSocket /live: changes come from it, commands and their answers go over it.

import { merge } from "./model.js";

const RETRY = 1000;  // until the next attempt [ms]
const SILENCE = 4000;  // after which the connection counts as lost; the server sends something every second [ms]
const UNAUTHORISED = 4401;

let socket = null;
let retry = 0;
let hasData = false;
let lostAt = null;
let heardAt = 0;
let whenAnswered = () => {};
let whenChanged = () => {};

/** Connects, and again whenever the connection is lost. */
export function begin({ onAnswer, onChange }) {
  whenAnswered = onAnswer;
  whenChanged = onChange;
  // A hidden page disconnects; when it is visible again, it gets a full snapshot.
  document.addEventListener("visibilitychange", () => document.hidden ? socket?.close() : connect());
  setInterval(closeIfSilent, SILENCE / 4);
  connect();
}

export const isConnected = () => socket?.readyState === WebSocket.OPEN && hasData;

/** How long there has been no connection [s]; 0 while there is one. */
export const lostFor = () => lostAt === null ? 0 : (Date.now() - lostAt) / 1000;

export function send(command) {
  if (isConnected()) socket.send(JSON.stringify(command));
  else whenAnswered({ good: false, text: "not connected: nothing was sent" });
}

function connect() {
  if (socket || document.hidden) return;
  socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/live`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = event => {
    if (typeof event.data === "string") whenAnswered(JSON.parse(event.data).answer);
    else take(event.data);
  };
  socket.onclose = closed;
}

/** Gives up a connection over which nothing comes: a hung server closes none. */
function closeIfSilent() {
  if (!hasData || Date.now() - heardAt < SILENCE) return;
  const silent = socket;
  silent.onclose = silent.onmessage = null;
  silent.close();
  lostAt = heardAt;
  closed({ code: 1006 });
}

function take(buffer) {
  heardAt = Date.now();
  const news = JSON.parse(new TextDecoder().decode(buffer));
  const isBack = !hasData;
  hasData = true;
  lostAt = null;
  merge(news);
  if (isBack) whenChanged();
}

function closed(event) {
  socket = null;
  hasData = false;
  lostAt ??= Date.now();
  whenChanged();
  if (event.code === UNAUTHORISED || event.code === 1006) reloadIfLoggedOut();
  clearTimeout(retry);
  retry = setTimeout(connect, RETRY);
}

async function reloadIfLoggedOut() {
  try {
    const answer = await fetch("/static/main.js", { method: "HEAD" });
    if (answer.status === 401) location.reload();
  } catch {
    // The server does not answer: the next attempt tells.
  }
}
