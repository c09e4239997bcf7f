// Mouse, fingers and keys on the map: moving the view, selecting robots, aiming.

import { send } from "./connection.js";
import { select, selection, valueOf } from "./model.js";
import { arrow, drawLine, drawShape, fitMap, redraw, setOverlay, shownRobots } from "./map.js";
import { canvas, metre, pan, pixel, view, zoom } from "./view.js";

const CLICKED = 20;  // maximum distance from a robot to select it [pixels]
const DRAGGED = 6;  // minimum distance of a drag [pixels]
const KEY_STEP = 60;  // of an arrow key [pixels]
const KEY_ZOOM = 1.25;
const ACCENT = "#1976d2";

const pointers = new Map();
let tool = "view";
let drag = null;
let whenChanged = () => {};

export const currentTool = () => tool;

export function setTool(name) {
  tool = name;
}

/** Listens to the map; calls `onChange` when the selection or the view's mode has changed. */
export function begin(onChange) {
  whenChanged = onChange;
  const map = canvas();
  map.addEventListener("pointerdown", pressed);
  map.addEventListener("pointermove", moved);
  map.addEventListener("pointerup", released);
  map.addEventListener("pointercancel", event => {
    pointers.delete(event.pointerId);
    drag = null;
  });
  map.addEventListener("pointerleave", () => showCursor(null));
  map.addEventListener("contextmenu", event => event.preventDefault());
  map.addEventListener("wheel", turned, { passive: false });
  map.addEventListener("keydown", keyPressed);
  setOverlay(drawAim);
}

function at(event) {
  const box = canvas().getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

function pressed(event) {
  const place = at(event);
  if (event.isTrusted) canvas().setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, place);
  const aims = tool !== "view" && event.button === 0 && pointers.size === 1;
  drag = {
    from: place,
    last: place,
    robot: robotNear(place),
    place: aims ? metre(...place) : null,
    end: metre(...place),
    yaw: 0,
    moved: false,
  };
}

/** The robot under a pixel; null if there is none. */
function robotNear([u, v]) {
  let nearest = null;
  let least = CLICKED;
  for (const robot of shownRobots()) {
    const [x, y] = pixel(...valueOf(robot, "pose"));
    const away = Math.hypot(x - u, y - v);
    if (away < least) [nearest, least] = [robot, away];
  }
  return nearest;
}

function moved(event) {
  const place = at(event);
  showCursor(place);
  if (!drag || !pointers.has(event.pointerId)) return;
  const before = [...pointers.values()];
  pointers.set(event.pointerId, place);
  if (pointers.size === 2) pinched(before, [...pointers.values()]);
  else if (drag.moved || distance(place, drag.from) > DRAGGED) dragged(place);
  drag.last = place;
  redraw();
}

function pinched(before, now) {
  const middle = [(now[0][0] + now[1][0]) / 2, (now[0][1] + now[1][1]) / 2];
  zoom(distance(...now) / Math.max(1, distance(...before)), ...middle);
  drag.place = null;
  drag.moved = true;
}

function dragged(place) {
  drag.moved = true;
  drag.end = metre(...place);
  if (drag.place) {
    drag.yaw = Math.atan2(drag.from[1] - place[1], place[0] - drag.from[0]);
    return;
  }
  pan(place[0] - drag.last[0], place[1] - drag.last[1]);
  whenChanged();
}

function released(event) {
  pointers.delete(event.pointerId);
  if (!drag || pointers.size) return;
  const { place, robot, moved: hasMoved, yaw } = drag;
  drag = null;
  redraw();
  if (!place) {
    if (!hasMoved && robot) choose(robot, event.shiftKey || event.ctrlKey);
    return;
  }
  const [x, y] = place;
  const heading = hasMoved ? { yaw } : {};
  if (tool === "measure") return;
  if (tool === "spawn") send({ do: "spawn", x, y });
  else if (tool === "locate") send({ do: "locate", robots: selection(), x, y, ...heading });
  else send({ do: "drive", robots: selection(), x, y, ...heading, append: tool === "append" });
}

/** Selects a robot, or adds it to the selection. */
export function choose(robot, more) {
  select(robot, more);
  whenChanged();
  redraw();
}

/** Shows a robot in the middle of the map. */
export function centreOn(robot) {
  const pose = valueOf(robot, "pose");
  if (pose) [view.x, view.y] = pose;
  redraw();
}

function turned(event) {
  event.preventDefault();
  zoom(Math.exp(-event.deltaY / 500), ...at(event));
  redraw();
}

function keyPressed(event) {
  const steps = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const middle = [canvas().clientWidth / 2, canvas().clientHeight / 2];
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key in steps) {
    const [right, down] = steps[event.key];
    pan(right * KEY_STEP, down * KEY_STEP);
  } else if (event.key === "+" || event.key === "=") zoom(KEY_ZOOM, ...middle);
  else if (event.key === "-") zoom(1 / KEY_ZOOM, ...middle);
  else if (event.key === "0") fitMap();
  else return;
  event.preventDefault();
  whenChanged();
  redraw();
}

function drawAim(context) {
  if (!drag?.place) return;
  if (tool !== "measure") {
    drawShape(context, [...drag.place, drag.yaw], arrow(0.6), ACCENT);
    return;
  }
  drawLine(context, [drag.place, drag.end], ACCENT, 2);
  const [u, v] = pixel(...drag.end);
  context.fillStyle = ACCENT;
  context.fillText(`${distance(drag.place, drag.end).toFixed(2)} m`, u + 8, v - 8);
}

function showCursor(place) {
  const element = document.getElementById("cursor");
  if (!place || !view.scale) element.textContent = "";
  else element.textContent = metre(...place).map(length => length.toFixed(2)).join(", ") + " m";
}

const distance = ([u, v], [x, y]) => Math.hypot(u - x, v - y);
