// What is known of the fleet: values by name, as the server streams them.

export const values = {};

/** Calls each listener with the values that have changed. */
const listeners = [];

export function onNews(listener) {
  listeners.push(listener);
}

export function merge(news) {
  Object.assign(values, news);
  for (const listener of listeners) listener(news);
}

/** The robots' names in the order of their computers. */
export const robotNames = () => Object.keys(values.fleet ?? {});

/** The colour of a robot, as in RViz. */
export const colourOf = robot => values.fleet?.[robot] ?? "#888";

/** A value of a robot, such as its pose. */
export const valueOf = (robot, name) => values[`${robot}.${name}`];

/** The robot's row in the table: its figures and its state. */
export const rowOf = robot => valueOf(robot, "row") ?? {};

// ---- the selected robots

let selected = new Set();

export const selection = () => [...selected];

export const isSelected = robot => selected.has(robot);

export function select(robot, more) {
  if (!more) selected = new Set([robot]);
  else if (!selected.delete(robot)) selected.add(robot);
}

/** Text that is safe in HTML. */
export const escaped = text =>
  String(text ?? "").replace(/[&<>"]/g, character => `&#${character.charCodeAt(0)};`);
