// What the buttons and keys do.

import { send } from "./connection.js";
import { askDoctor, confirmed, showCameras } from "./dialogs.js";
import { fitMap, redraw } from "./map.js";
import { robotNames, rowOf, selection, values } from "./model.js";
import { currentTool, setTool } from "./pointer.js";
import { keep } from "./settings.js";
import { view } from "./view.js";

const KEYS = { v: "tool-view", d: "tool-drive", a: "tool-append", l: "tool-locate", b: "tool-spawn", m: "tool-measure", f: "follow" };

const ACTIONS = {
  "stop-all": () => send({ do: "stop", robots: robotNames() }),
  "release-all": releaseAll,
  stop: () => send({ do: "stop", robots: selection() }),
  release: () => send({ do: "release", robots: selection() }),
  cancel: () => send({ do: "cancel", robots: selection() }),
  patrol: () => send({ do: "patrol", robots: selection(), on: !allPatrol() }),
  record: () => send({ do: "record", on: !values.recording }),
  "simulate-pause": () => send({ do: "simulate", action: "pause" }),
  "simulate-resume": () => send({ do: "simulate", action: "resume" }),
  "simulate-step": () => send({ do: "simulate", action: "step" }),
  "simulate-reset": reset,
  follow: () => { view.follow = !view.follow; },
  fit: () => { view.follow = false; fitMap(); },
  cameras: showCameras,
  doctor: askDoctor,
  theme: () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),
  logout: () => fetch("/logout", { method: "POST" }).then(() => location.replace("/")),
};

/** Does what a button says. */
export function act(name) {
  if (name.startsWith("tool-")) setTool(name.slice("tool-".length));
  else ACTIONS[name]?.();
  markButtons();
  redraw();
}

/** Does what a key means outside text fields and windows. */
export function keyPressed(event) {
  const isTyping = event.target.closest("input, select, dialog");
  if (isTyping || event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.key in KEYS) act(KEYS[event.key]);
}

export function setTheme(theme) {
  if (theme) document.documentElement.dataset.theme = theme;
  keep({ theme });
}

/** Shows which tools and modes are on. */
export function markButtons() {
  const isOn = {
    [`tool-${currentTool()}`]: true,
    follow: view.follow,
    patrol: allPatrol(),
  };
  for (const button of document.querySelectorAll("[data-act]")) {
    const name = button.dataset.act;
    button.classList.toggle("active", Boolean(isOn[name]));
    if (name.startsWith("tool-") || name in isOn) button.ariaPressed = String(Boolean(isOn[name]));
    if (name === "record") button.classList.toggle("recording", Boolean(values.recording));
  }
}

const allPatrol = () => selection().length > 0 && selection().every(robot => rowOf(robot).patrols);

async function releaseAll() {
  const held = robotNames().filter(robot => rowOf(robot).held);
  const question = `Release ${held.length ? held.join(", ") : "all robots"}? They take waypoints again.`;
  if (await confirmed(question, "Release all")) send({ do: "release", robots: robotNames() });
}

async function reset() {
  const question = "Reset the world? Robots and objects return to where they started, and robots are localised there.";
  if (await confirmed(question, "Reset")) send({ do: "simulate", action: "reset" });
}
