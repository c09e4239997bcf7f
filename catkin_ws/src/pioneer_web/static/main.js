// The page: connects its parts.

import { act, keyPressed, markButtons, setTheme } from "./actions.js";
import { showAlerts } from "./alerts.js";
import * as connection from "./connection.js";
import { send } from "./connection.js";
import { showLog } from "./log.js";
import { labelBoxes, redraw, shownRobots } from "./map.js";
import { onNews, robotNames, select, selection, values } from "./model.js";
import { showNetwork } from "./network.js";
import * as pointer from "./pointer.js";
import { keep, settings } from "./settings.js";
import { showTable, sortBy } from "./table.js";
import { forget } from "./trails.js";
import { canvas, metre, pixel, view } from "./view.js";

const AGES = 500;  // between two updates of what ages while there is no connection [ms]
const LAYERS = {
  scan: "laser scans", costs: "local costmaps", plans: "plans: global (darkest), local", trails: "trails",
  goals: "waypoints", names: "names", objects: "moving and added objects",
};

const element = id => document.getElementById(id);
const tabs = [...document.querySelectorAll("[role=tab]")];
let missed = {};

// ---- what the server sends

onNews(news => {
  if (news.fleet && !selection().length && robotNames().length) select(robotNames()[0]);
  // Hidden tables are brought up to date when their tab is opened.
  Object.assign(missed, news);
  show();
});

/** Shows the news in whatever is visible. */
function show() {
  const news = missed;
  missed = {};
  const has = (...names) => names.some(name => name in news);
  const rows = has("fleet") || robotNames().some(robot => `${robot}.row` in news);
  if (has("time", "factor", "paused")) showClock();
  if (rows) showTable();
  if (rows || has("recording")) markButtons();
  if (has("alerts")) showAlerts();
  if (news.replay) showReplay(...news.replay);
  if (has("network", "rules", "hub", "gateway")) showNetwork();
  if (Object.keys(news).some(name => name.startsWith("log."))) showLog();
}

function showClock() {
  const { time, factor, paused, replay } = values;
  const rate = paused ? "paused" : `× ${(factor ?? 0).toFixed(2)}`;
  element("clock").textContent = `${(time ?? 0).toFixed(0)} s  ${replay ? "replay" : rate}`;
}

function showReplay(position, length) {
  const slider = document.querySelector("#replay input");
  element("replay").hidden = false;
  slider.max = length;
  if (!slider.matches(":active")) slider.value = position;
  document.querySelector("#replay span").textContent = `${position.toFixed(0)} of ${length.toFixed(0)} s`;
}

function showAnswer({ good, text }) {
  const line = document.createElement("p");
  line.textContent = text;
  line.className = good ? "" : "bad";
  const recording = text.match(/(fleet-[-0-9]+\.mcap): \d+ messages/)?.[1];
  if (recording) {
    const link = { href: `/recordings/${recording}`, download: recording, textContent: " Download" };
    line.append(Object.assign(document.createElement("a"), link));
  }
  element("answers").append(line);
  setTimeout(() => line.remove(), recording ? 20000 : good ? 3000 : 8000);
}

function showConnection() {
  const isLost = !connection.isConnected();
  document.body.classList.toggle("disconnected", isLost);
  element("banner").hidden = !isLost;
  for (const button of document.querySelectorAll("#tools button, header button")) {
    const needsServer = !/^(tool-|follow|fit|theme|logout)/.test(button.dataset.act);
    button.disabled = isLost && needsServer;
  }
  if (isLost) showAges();
}

/** While there is no connection: how old everything is. */
function showAges() {
  if (connection.isConnected()) return;
  element("banner").textContent =
    `No connection for ${connection.lostFor().toFixed(0)} s: all figures are at least as old. Connecting again …`;
  showTable();
}

// ---- what the user does

function openTab(name) {
  for (const tab of tabs) {
    const isOpen = tab.id === `tab-${name}`;
    tab.ariaSelected = String(isOpen);
    tab.tabIndex = isOpen ? 0 : -1;
    element(tab.getAttribute("aria-controls")).hidden = !isOpen;
  }
  keep({ tab: name });
}

/** Arrow keys move between tabs. */
function tabKeyPressed(event) {
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!step) return;
  const next = tabs[(tabs.indexOf(event.target) + step + tabs.length) % tabs.length];
  openTab(next.id.slice("tab-".length));
  next.focus();
}

function addLayers() {
  for (const [name, text] of Object.entries(LAYERS)) {
    const label = document.createElement("label");
    const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: settings.layers[name] });
    box.addEventListener("change", () => {
      keep({ layers: { ...settings.layers, [name]: box.checked } });
      redraw();
    });
    label.append(box, text);
    document.querySelector("#layers fieldset").append(label);
  }
}

function clicked(event) {
  const button = event.target.closest("[data-act]");
  const column = event.target.closest("[data-sort]");
  const tab = event.target.closest("[role=tab]");
  const row = event.target.closest("[data-robot]");
  if (button) act(button.dataset.act);
  else if (column) sortBy(column.dataset.sort);
  else if (tab) openTab(tab.id.slice("tab-".length));
  else if (row) pointer.choose(row.dataset.robot, event.shiftKey || event.ctrlKey);
}

function doubleClicked(event) {
  const row = event.target.closest("[data-robot]");
  if (row) pointer.centreOn(row.dataset.robot);
}

pointer.begin(() => {
  showTable();
  markButtons();
});
document.addEventListener("click", clicked);
document.addEventListener("dblclick", doubleClicked);
document.addEventListener("keydown", keyPressed);
document.querySelector("[role=tablist]").addEventListener("keydown", tabKeyPressed);
for (const id of ["filter", "least"]) element(id).addEventListener("input", showLog);
document.querySelector("#replay input").addEventListener("change", event => {
  forget();
  send({ do: "seek", at: Number(event.target.value) });
});
new ResizeObserver(redraw).observe(canvas());
setInterval(showAges, AGES);

if (settings.theme) setTheme(settings.theme);
openTab(settings.tab);
addLayers();
markButtons();
connection.begin({ onAnswer: showAnswer, onChange: showConnection });

// For tests and for the curious.
window.fleetPage = { state: values, pixel, view, metre, shown: shownRobots, labels: labelBoxes };
