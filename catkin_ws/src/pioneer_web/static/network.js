// The gateways with their links, and the rules that need attention.

import { colourOf, escaped, rowOf, values } from "./model.js";

const ROW = 36;
const BASE = { left: 4, width: 130, height: 40 };
const ROBOT = { left: 260, width: 240, height: 32 };
const WIDTH = ROBOT.left + ROBOT.width + 4;

export function showNetwork() {
  document.getElementById("network").innerHTML = picture() + rules();
}

function picture() {
  const links = Object.entries(values.network ?? {});
  const height = Math.max(120, ROW * links.length + 20);
  const middle = height / 2;
  const rows = links.map(([gateway, link], index) => row(gateway, link, 26 + ROW * index, middle));
  return `<svg viewBox="0 0 ${WIDTH} ${height}" role="img" aria-label="Gateways and their links">
    <rect x="${BASE.left}" y="${middle - BASE.height / 2}" width="${BASE.width}" height="${BASE.height}" rx="4" fill="none" stroke="currentColor"/>
    <text x="${BASE.left + 6}" y="${middle - 4}">${escaped(values.gateway || "no gateway")}</text>
    <text x="${BASE.left + 6}" y="${middle + 12}">${escaped(values.hub || "no hub")}</text>${rows.join("")}</svg>`;
}

function row(gateway, link, y, middle) {
  const isBad = link.active < link.rules && Boolean(rowOf(link.robot).fault);
  const colour = isBad ? "var(--bad)" : colourOf(link.robot);
  const dashes = isBad ? 'stroke-dasharray="5"' : "";
  const flow = `${link.active}/${link.rules} rules, ${link.rate} Hz, ${(link.bytes / 1000).toFixed(0)} kB/s`;
  return `<line x1="${BASE.left + BASE.width}" y1="${middle}" x2="${ROBOT.left}" y2="${y}" stroke="${colour}" stroke-width="2" ${dashes}/>
    <rect x="${ROBOT.left}" y="${y - ROBOT.height / 2}" width="${ROBOT.width}" height="${ROBOT.height}" rx="4" fill="none" stroke="${colour}"/>
    <text x="${ROBOT.left + 6}" y="${y - 3}">${escaped(gateway)}</text>
    <text x="${ROBOT.left + 6}" y="${y + 11}">${flow}</text>`;
}

function rules() {
  const idle = values.rules ?? [];
  if (!idle.length) return "<p>All rules are active.</p>";
  const rows = idle.map(rule => `<tr><td>${escaped(rule.gateway)}</td><td>${escaped(rule.name)}</td>
    <td class="bad">${escaped(rule.state)}</td><td>${escaped(rule.reason)}</td></tr>`);
  return `<table><tr><th>Gateway</th><th>Topic</th><th>State</th><th>Reason</th></tr>${rows.join("")}</table>`;
}
