// What the nodes of all computers log.

import { escaped, values } from "./model.js";

const LEVELS = ["debug", "info", "warning", "error", "fatal"];

/** Shows the lines that the filter lets through, the newest first; equal ones in a row once, with their number. */
export function showLog() {
  const words = document.getElementById("filter").value.toLowerCase().split(/\s+/);
  const least = LEVELS.indexOf(document.getElementById("least").value);
  const isShown = entry => LEVELS.indexOf(entry.level) >= least
    && words.every(word => entry.searched.includes(word));
  const lines = grouped(entries().filter(isShown)).map(line);
  document.getElementById("log").innerHTML = lines.join("");
}

function entries() {
  return Object.keys(values)
    .filter(key => key.startsWith("log.") && values[key])
    .map(key => {
      const [number, stamp, level, computer, node, text] = values[key];
      const from = computer || "base";
      return { number, stamp, level, from, node, text, searched: `${level} ${from} ${node} ${text}`.toLowerCase() };
    })
    .sort((a, b) => b.number - a.number);
}

function grouped(found) {
  const groups = [];
  for (const entry of found) {
    const last = groups.at(-1);
    const isSame = last && ["from", "node", "level", "text"].every(key => last[key] === entry[key]);
    if (isSame) last.count += 1;
    else groups.push({ ...entry, count: 1 });
  }
  return groups;
}

function line({ stamp, level, from, node, text, count }) {
  const times = count > 1 ? ` (${count} times)` : "";
  return `<div class="${escaped(level)}">${stamp.toFixed(1)} <b>${escaped(from)}</b> ${escaped(node)}: ${escaped(text)}${times}</div>`;
}
