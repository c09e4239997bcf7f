// Where the robots have been.

import { robotNames, valueOf } from "./model.js";

const LONGEST = 600;  // points
const STEP = 0.05;  // between two points [m]
const JUMP = 2.0;  // farther than a robot drives between two updates: it was moved, so its trail starts over [m]

const trails = new Map();

export const trailOf = robot => trails.get(robot) ?? [];

export function forget() {
  trails.clear();
}

/** Adds the robots' places that are news. */
export function extend(news) {
  for (const robot of robotNames()) {
    if (!news[`${robot}.pose`]) continue;
    const [x, y] = valueOf(robot, "pose");
    let trail = trailOf(robot);
    const last = trail.at(-1);
    const moved = last ? Math.hypot(last[0] - x, last[1] - y) : Infinity;
    if (last && moved > JUMP) trail = [];
    if (moved > STEP) trail.push([x, y]);
    if (trail.length > LONGEST) trail.shift();
    trails.set(robot, trail);
  }
}
