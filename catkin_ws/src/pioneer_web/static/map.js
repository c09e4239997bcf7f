// Draws the map with the robots and what they see and plan.

import { colourOf, isSelected, onNews, robotNames, rowOf, selection, values, valueOf } from "./model.js";
import { settings } from "./settings.js";
import { extend, trailOf } from "./trails.js";
import { canvas, fit, pixel, view } from "./view.js";

const FOOTPRINT = [[0.2, 0.2], [0.2, -0.2], [-0.3, -0.2], [-0.3, 0.2]];
const BOX = [[0.25, 0.25], [0.25, -0.25], [-0.25, -0.25], [-0.25, 0.25]];
const SMALLEST_ROBOT = 14;  // pixels, so that it can be seen and clicked when zoomed out
const ACCENT = "#1976d2";
const BAD = "#c10015";
const FONT = "600 13px system-ui, sans-serif";

const images = new Map();
let labels = [];
let overlay = () => {};
let requested = false;

/** The robots that are drawn, and the boxes [left, top, width, height] of their names in pixels. */
export const shownRobots = () => robotNames().filter(robot => valueOf(robot, "pose"));
export const labelBoxes = () => labels;

export const fitMap = () => fit(values.map, images.get("map"));

/** Draws soon; several requests draw once. */
export function redraw() {
  if (requested) return;
  requested = true;
  requestAnimationFrame(() => {
    requested = false;
    draw();
  });
}

/** Draws whatever the user is doing on the map, such as aiming, on top. */
export function setOverlay(drawOverlay) {
  overlay = drawOverlay;
}

onNews(news => {
  extend(news);
  if (news.map) load("map", `/map.png?${news.map.version}-${Date.now()}`, fitMap);
  for (const robot of robotNames()) {
    const costs = news[`${robot}.costs`];
    if (costs) load(robot, `data:image/png;base64,${costs.png}`);
  }
  redraw();
});

function load(name, source, then) {
  const image = new Image();
  image.onload = () => {
    images.set(name, image);
    then?.();
    redraw();
  };
  image.src = source;
}

function draw() {
  const context = canvas().getContext("2d");
  resize(context);
  const map = values.map;
  const image = images.get("map");
  if (!map || !image || !view.scale) return;
  const leader = selection().find(robot => valueOf(robot, "pose"));
  if (view.follow && leader) [view.x, view.y] = valueOf(leader, "pose");
  const layers = settings.layers;
  const robots = robotNames();
  drawImageOfMap(context, map, image);
  if (layers.costs) for (const robot of robots) drawCosts(context, robot);
  for (const robot of robots) drawWays(context, robot, layers);
  if (layers.objects) for (const [, x, y] of values.actors ?? []) drawShape(context, [x, y, 0], BOX, "#666");
  for (const robot of robots) drawRobot(context, robot, layers);
  labels = layers.names ? drawLabels(context) : [];
  overlay(context);
  showScale();
}

/** Fits the canvas's pixels to its size on the screen. */
function resize(context) {
  const element = canvas();
  const ratio = devicePixelRatio || 1;
  const width = Math.round(element.clientWidth * ratio);
  const height = Math.round(element.clientHeight * ratio);
  if (element.width !== width || element.height !== height) {
    element.width = width;
    element.height = height;
    if (!view.scale) fitMap();
  }
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, element.clientWidth, element.clientHeight);
  context.lineJoin = context.lineCap = "round";
  context.font = FONT;
}

function drawImageOfMap(context, map, image) {
  const isDark = getComputedStyle(document.documentElement).colorScheme === "dark"
    || !document.documentElement.dataset.theme && matchMedia("(prefers-color-scheme: dark)").matches;
  context.imageSmoothingEnabled = false;
  context.globalAlpha = isDark ? 0.75 : 1;
  const [left, top] = pixel(map.x, map.y + map.height);
  context.drawImage(image, left, top, map.width * view.scale, map.height * view.scale);
  context.globalAlpha = 1;
}

function drawCosts(context, robot) {
  const costs = valueOf(robot, "costs");
  const image = images.get(robot);
  if (!costs || !image) return;
  const [x, y, yaw] = costs.at;
  const [width, height] = costs.size.map(length => length * view.scale);
  context.save();
  context.translate(...pixel(x, y));
  context.rotate(-yaw);
  context.globalAlpha = 0.7;
  context.drawImage(image, 0, -height, width, height);
  context.restore();
}

/** Draws a robot's trail and plans. */
function drawWays(context, robot, layers) {
  const colour = colourOf(robot);
  if (layers.trails) {
    context.globalAlpha = 0.35;
    drawLine(context, trailOf(robot), colour, 2);
    context.globalAlpha = 1;
  }
  if (!layers.plans) return;
  drawLine(context, points(valueOf(robot, "plan")), darker(colour, 0.55), 2.5);
  drawLine(context, points(valueOf(robot, "local")), darker(colour, 0.8), 4);
}

function drawRobot(context, robot, layers) {
  const colour = colourOf(robot);
  if (layers.goals) {
    const size = 12 / view.scale + 0.1;
    for (const goal of valueOf(robot, "goals") ?? []) drawShape(context, goal, arrow(size), colour);
  }
  const pose = valueOf(robot, "pose");
  if (!pose) return;
  if (layers.scan) drawScan(context, robot);
  const size = Math.max(1, SMALLEST_ROBOT / (0.5 * view.scale));
  const body = FOOTPRINT.map(([x, y]) => [x * size, y * size]);
  drawShape(context, pose, body, isBad(robot) ? BAD : darker(colour, 0.85));
  drawShape(context, pose, arrow(0.16 * size), "#fff");
  if (isSelected(robot)) drawRing(context, pose, 0.42 * size * view.scale);
}

function drawRing(context, [x, y], radius) {
  context.beginPath();
  context.arc(...pixel(x, y), radius, 0, 2 * Math.PI);
  context.strokeStyle = ACCENT;
  context.lineWidth = 2;
  context.stroke();
}

function drawScan(context, robot) {
  const [first, step, ranges, seenFrom] = valueOf(robot, "scan") ?? [];
  if (!seenFrom) return;
  const [mountX, mountY, mountYaw] = valueOf(robot, "mount") ?? [0, 0, 0];
  const [x, y, yaw] = seenFrom;
  const laserX = x + Math.cos(yaw) * mountX - Math.sin(yaw) * mountY;
  const laserY = y + Math.sin(yaw) * mountX + Math.cos(yaw) * mountY;
  context.fillStyle = colourOf(robot);
  ranges.forEach((centimetres, beam) => {
    if (!centimetres) return;
    const angle = yaw + mountYaw + first + beam * step;
    const range = centimetres / 100;
    const [u, v] = pixel(laserX + range * Math.cos(angle), laserY + range * Math.sin(angle));
    context.fillRect(u - 1.5, v - 1.5, 3, 3);
  });
}

function drawLabels(context) {
  const taken = [];
  for (const robot of shownRobots()) {
    const [u, v] = pixel(...valueOf(robot, "pose"));
    taken.push([u - 14, v - 14, 28, 28]);
  }
  const robotBoxes = taken.length;
  for (const robot of shownRobots()) drawLabel(context, robot, taken);
  return taken.slice(robotBoxes);
}

/** Draws a robot's name above it, or at the nearest place where it covers nothing; adds its box to those taken. */
function drawLabel(context, robot, taken) {
  const row = rowOf(robot);
  const mark = row.held ? " STOPPED" : row.fault ? " !" : "";
  const text = robot + mark;
  const width = context.measureText(text).width + 8;
  const height = 18;
  const sideways = width / 2 + 16;
  const offsets = [[0, -26], [0, 26], [sideways, 0], [-sideways, 0], [0, -46], [0, 46], [0, -66], [0, 66]];
  const [x, y] = pixel(...valueOf(robot, "pose"));
  const places = offsets.map(([right, down]) => [x + right - width / 2, y + down - height / 2]);
  const isFree = ([left, top]) => taken.every(([otherLeft, otherTop, otherWidth, otherHeight]) =>
    left + width < otherLeft || left > otherLeft + otherWidth
    || top + height < otherTop || top > otherTop + otherHeight);
  const [left, top] = places.find(isFree) ?? places[0];
  taken.push([left, top, width, height]);
  context.fillStyle = isBad(robot) ? BAD : "#fffd";
  context.fillRect(left, top, width, height);
  context.strokeStyle = colourOf(robot);
  context.lineWidth = 1.5;
  context.strokeRect(left, top, width, height);
  context.fillStyle = isBad(robot) ? "#fff" : "#222";
  context.fillText(text, left + 4, top + 13);
}

const isBad = robot => Boolean(rowOf(robot).held || rowOf(robot).fault);

const darker = (colour, part) => colour.replace(/\d+/g, value => Math.round(value * part));

/** An arrow ahead, of this size [m]. */
export const arrow = size => [[size, 0], [-size * 0.5, size * 0.5], [-size * 0.2, 0], [-size * 0.5, -size * 0.5]];

/** Fills a shape given in the frame of a pose [x, y, yaw]. */
export function drawShape(context, [x, y, yaw], corners, colour) {
  const cos = Math.cos(yaw);
  const sin = Math.sin(yaw);
  context.beginPath();
  for (const [u, v] of corners) context.lineTo(...pixel(x + cos * u - sin * v, y + sin * u + cos * v));
  context.closePath();
  context.fillStyle = colour;
  context.fill();
}

/** Draws a line through points [x, y] in metres. */
export function drawLine(context, line, colour, width) {
  if (line.length < 2) return;
  context.beginPath();
  for (const [x, y] of line) context.lineTo(...pixel(x, y));
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}

/** The points of a streamed line, which is x, y, x, y … in centimetres. */
function points(numbers) {
  const found = [];
  for (let i = 0; i + 1 < (numbers?.length ?? 0); i += 2) found.push([numbers[i] / 100, numbers[i + 1] / 100]);
  return found;
}

/** Shows how long a round number of metres is. */
function showScale() {
  const wide = 100 / view.scale;
  const power = 10 ** Math.floor(Math.log10(wide));
  const length = [5, 2, 1].map(part => part * power).find(one => one <= wide);
  const element = document.getElementById("scale");
  element.querySelector("i").style.width = `${length * view.scale}px`;
  element.querySelector("span").textContent = `${length} m`;
}
