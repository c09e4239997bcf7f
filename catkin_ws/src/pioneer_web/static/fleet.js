// Draws the fleet on a canvas and updates the tables with data from the WebSocket /live; sends commands over it.
"use strict";
(() => {
  // Robot names in the order of their computers, and the colour of each.
  let names = [], FLEET = {};
  const state = {}, trails = new Map(), images = new Map();
  const FOOTPRINT = [[0.2, 0.2], [0.2, -0.2], [-0.3, -0.2], [-0.3, 0.2]], TRAIL = 600;
  const view = { x: 0, y: 0, scale: 0, follow: false };
  let tool = "view", selected = new Set(), socket = null, drag = null, wake = 0, drawn = false, laid = false, shown = [], labels = [];
  const pointers = new Map(), element = id => document.getElementById(id);
  const of = (name, what) => state[`${name}.${what}`];
  const escaped = text => String(text ?? "").replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);

  function connect() {
    if (socket || document.hidden) return;
    socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onmessage = event => typeof event.data === "string" ? answered(JSON.parse(event.data).answer) : take(event.data);
    socket.onclose = event => {
      socket = null;
      if (element("clock")) element("clock").textContent = "no connection";
      if (event.code === 4401 || event.code === 1006 && !drawn) fetch("/map.png").then(a => a.status === 401 && location.reload());
      clearTimeout(wake);
      wake = setTimeout(connect, 1000);
    };
  }
  // A hidden page disconnects; when visible again it reconnects and gets a full snapshot.
  document.addEventListener("visibilitychange", () => document.hidden ? socket?.close() : connect());

  function send(command) {
    if (socket?.readyState === 1) socket.send(JSON.stringify(command));
    else answered({ good: false, text: "not connected: nothing was sent" });
  }

  function answered(answer) {
    const line = document.createElement("p");
    line.textContent = answer.text;
    line.className = answer.good ? "" : "bad";
    const file = answer.text.match(/(fleet-[-0-9]+\.mcap): \d+ messages/)?.[1];
    if (file) line.append(Object.assign(document.createElement("a"), { href: `/recordings/${file}`, download: file, textContent: " Download" }));
    element("answers").append(line);
    setTimeout(() => line.remove(), file ? 20000 : answer.good ? 3000 : 8000);
  }

  function take(buffer) {
    const news = JSON.parse(new TextDecoder().decode(buffer));
    Object.assign(state, news);
    if (news.fleet) {
      names = Object.keys(FLEET = news.fleet);
      if (!selected.size) selected.add(names[0]);
    }
    for (const name of names) {
      const pose = news[`${name}.pose`];
      if (!pose) continue;
      const trail = trails.get(name) ?? [];
      const last = trail.at(-1);
      if (!last || Math.hypot(last[0] - pose[0], last[1] - pose[1]) > 0.05) trail.push(pose);
      if (trail.length > TRAIL) trail.shift();
      trails.set(name, trail);
    }
    if (news.map) picture("map", `/map.png?${news.map.version}-${Date.now()}`, fit);
    for (const name of names) if (news[`${name}.costs`]) picture(name, `data:image/png;base64,${news[`${name}.costs`].png}`);
    drawn = true;
    if (laid) words(news);
    requestAnimationFrame(draw);
  }

  function picture(name, source, then) {
    const image = new Image();
    image.onload = () => { images.set(name, image); then?.(); requestAnimationFrame(draw); };
    image.src = source;
  }

  // ---- the map

  const canvas = () => element("map");
  const pixel = (x, y) => [canvas().clientWidth / 2 + (x - view.x) * view.scale, canvas().clientHeight / 2 - (y - view.y) * view.scale];
  const metre = (u, v) => [view.x + (u - canvas().clientWidth / 2) / view.scale, view.y - (v - canvas().clientHeight / 2) / view.scale];

  // Fits the view to the known part of the map, without the unknown area around it.
  function fit() {
    const map = state.map, image = images.get("map");
    if (!map || !image || !canvas()) return;
    const probe = document.createElement("canvas"), size = 400;
    probe.width = probe.height = size;
    const context = probe.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0, size, size);
    const data = context.getImageData(0, 0, size, size).data;
    let left = size, right = -1, top = size, bottom = -1;
    for (let row = 0, at = 0; row < size; row++) for (let col = 0; col < size; col++, at += 4)
      if (data[at] !== data[at + 2]) continue;
      else { left = Math.min(left, col); right = Math.max(right, col); top = Math.min(top, row); bottom = Math.max(bottom, row); }
    if (right < 0) { left = top = 0; right = bottom = size - 1; }
    const width = (right - left + 1) / size * map.width, height = (bottom - top + 1) / size * map.height;
    view.x = map.x + left / size * map.width + width / 2;
    view.y = map.y + map.height - top / size * map.height - height / 2;
    view.scale = 0.94 * Math.min(canvas().clientWidth / width, canvas().clientHeight / height);
  }

  function line(context, points, colour, width, scale = 0.01) {
    if (!points || points.length < 4) return;
    context.beginPath();
    for (let i = 0; i < points.length; i += 2) context.lineTo(...pixel(points[i] * scale, points[i + 1] * scale));
    context.strokeStyle = colour; context.lineWidth = width; context.stroke();
  }

  function shape(context, pose, points, colour) {
    const [x, y, yaw] = pose, cos = Math.cos(yaw), sin = Math.sin(yaw);
    context.beginPath();
    for (const [u, v] of points) context.lineTo(...pixel(x + cos * u - sin * v, y + sin * u + cos * v));
    context.closePath(); context.fillStyle = colour; context.fill();
  }

  const arrow = size => [[size, 0], [-size * 0.5, size * 0.5], [-size * 0.2, 0], [-size * 0.5, -size * 0.5]];
  const darker = (colour, part) => colour.replace(/\d+/g, value => Math.round(value * part));

  function scan(context, name) {
    const beams = of(name, "scan"), mount = of(name, "mount") ?? [0, 0, 0];
    if (!beams?.[3]) return;
    const [x, y, yaw] = beams[3], cos = Math.cos(yaw), sin = Math.sin(yaw);
    const left = x + cos * mount[0] - sin * mount[1], up = y + sin * mount[0] + cos * mount[1];
    context.fillStyle = FLEET[name];
    beams[2].forEach((range, i) => {
      if (!range) return;
      const angle = yaw + mount[2] + beams[0] + i * beams[1];
      const [u, v] = pixel(left + range / 100 * Math.cos(angle), up + range / 100 * Math.sin(angle));
      context.fillRect(u - 1.5, v - 1.5, 3, 3);
    });
  }

  function costs(context, name) {
    const cost = of(name, "costs"), image = images.get(name);
    if (!cost || !image) return;
    const [x, y, yaw] = cost.at;
    context.save();
    context.translate(...pixel(x, y)); context.rotate(-yaw);
    context.imageSmoothingEnabled = false; context.globalAlpha = 0.7;
    context.drawImage(image, 0, -cost.size[1] * view.scale, cost.size[0] * view.scale, cost.size[1] * view.scale);
    context.restore();
  }

  // Places a label above its object, or at the nearest position that does not overlap other labels.
  function label(context, boxes, text, x, y, colour, bad) {
    const width = context.measureText(text).width + 8, height = 18;
    const places = [[0, -26], [0, 26], [width / 2 + 16, 0], [-width / 2 - 16, 0], [0, -46], [0, 46], [0, -66], [0, 66]];
    const free = places.map(([u, v]) => [x + u - width / 2, y + v - height / 2]).find(([u, v]) =>
      boxes.every(box => u + width < box[0] || u > box[0] + box[2] || v + height < box[1] || v > box[1] + box[3]));
    const [u, v] = free ?? [x - width / 2, y - 26 - height / 2];
    boxes.push([u, v, width, height]);
    context.fillStyle = bad ? "#c10015" : "#fffd"; context.fillRect(u, v, width, height);
    context.strokeStyle = colour; context.lineWidth = 1.5; context.strokeRect(u, v, width, height);
    context.fillStyle = bad ? "#fff" : "#222"; context.fillText(text, u + 4, v + 13);
  }

  function draw() {
    const element_ = canvas(), context = element_?.getContext("2d");
    if (!context) return;
    const ratio = devicePixelRatio || 1, width = element_.clientWidth, height = element_.clientHeight;
    if (element_.width !== Math.round(width * ratio) || element_.height !== Math.round(height * ratio)) {
      const first = !view.scale || !element_.dataset.sized;
      element_.width = Math.round(width * ratio); element_.height = Math.round(height * ratio);
      element_.dataset.sized = "1";
      if (first) fit();
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const map = state.map, image = images.get("map");
    if (!map || !image || !view.scale) return;
    const leader = [...selected].find(name => of(name, "pose"));
    if (view.follow && leader) [view.x, view.y] = of(leader, "pose");
    context.imageSmoothingEnabled = false;
    context.globalAlpha = document.body.classList.contains("body--dark") ? 0.75 : 1;
    context.drawImage(image, ...pixel(map.x, map.y + map.height), map.width * view.scale, map.height * view.scale);
    context.globalAlpha = 1;
    context.lineJoin = context.lineCap = "round";
    for (const name of names) costs(context, name);
    for (const name of names) {
      const colour = FLEET[name];
      context.globalAlpha = 0.35;
      line(context, (trails.get(name) ?? []).flatMap(pose => [pose[0], pose[1]]), colour, 2, 1);
      context.globalAlpha = 1;
      line(context, of(name, "plan"), darker(colour, 0.55), 2.5);
      line(context, of(name, "local"), darker(colour, 0.8), 4);
    }
    context.font = "600 13px system-ui, sans-serif";
    const boxes = [];
    for (const [name, x, y] of state.actors ?? []) {
      shape(context, [x, y, 0], [[0.25, 0.25], [0.25, -0.25], [-0.25, -0.25], [-0.25, 0.25]], "#666");
    }
    for (const name of names) {
      const pose = of(name, "pose"), bad = of(name, "row")?.fault;
      (of(name, "goals") ?? []).forEach(goal => shape(context, goal, arrow(12 / view.scale + 0.1), FLEET[name]));
      if (!pose) continue;
      scan(context, name);
      const [u, v] = pixel(pose[0], pose[1]), size = Math.max(1, 14 / (0.5 * view.scale));
      shape(context, pose, FOOTPRINT.map(([a, b]) => [a * size, b * size]), bad ? "#c10015" : darker(FLEET[name], 0.85));
      shape(context, pose, arrow(0.16 * size), "#fff");
      if (selected.has(name)) { context.beginPath(); context.arc(u, v, 0.42 * size * view.scale, 0, 7); context.strokeStyle = "#1976d2"; context.lineWidth = 2; context.stroke(); }
      boxes.push([u - 14, v - 14, 28, 28]);
    }
    for (const name of names) {
      const pose = of(name, "pose"), row = of(name, "row") ?? {}, bad = row.held || row.fault;
      if (pose) label(context, boxes, `${name}${row.held ? " STOPPED" : bad ? " !" : ""}`, ...pixel(pose[0], pose[1]), FLEET[name], bad);
    }
    if (drag?.place) shape(context, [...drag.place, drag.yaw], arrow(0.6), "#1976d2");
    shown = names.filter(name => of(name, "pose"));
    labels = boxes.slice(shown.length);
  }

  // ---- tables and text

  function words(news) {
    if ("time" in news || "factor" in news || "paused" in news)
      element("clock").textContent = `${(state.time ?? 0).toFixed(0)} s  ${state.paused ? "paused" : `× ${(state.factor ?? 0).toFixed(2)}`}`;
    if ("fleet" in news || names.some(name => `${name}.row` in news)) { robots(); mark(); }
    if ("recording" in news) mark();
    if (news.replay) replay(...news.replay);
    if ("network" in news || "rules" in news || "hub" in news) network();
    if (Object.keys(news).some(key => key.startsWith("log."))) log();
  }

  const seconds = age => age == null ? "none" : `${age.toFixed(1)} s`;

  function replay(at, length) {
    const [slider, text] = ["input", "span"].map(kind => document.querySelector(`#replay ${kind}`));
    element("replay").hidden = false;
    slider.max = length;
    if (!slider.matches(":active")) slider.value = at;
    text.textContent = `${at.toFixed(0)} of ${length.toFixed(0)} s`;
  }

  function robots() {
    const rows = names.map(name => {
      const row = of(name, "row") ?? {}, rules = state.network ? Object.values(state.network).find(one => one.robot === name) : null;
      const word = row.held ? "stopped, held" : row.fault ? row.fault : row.patrols ? `${row.state}, patrol` : row.state;
      return `<tr data-robot="${escaped(name)}" class="${selected.has(name) ? "selected" : ""}"><td><i style="background:${FLEET[name]}"></i>${escaped(name)}</td>
        <td class="${row.fault || row.held ? "bad" : ""}">${escaped(word)}</td><td>${(row.speed ?? 0).toFixed(2)}</td>
        <td>${row.deviation == null ? "–" : row.deviation.toFixed(2)}</td><td>${row.reached ?? 0}/${row.received ?? 0}</td>
        <td class="wide">${seconds(row.odom)}</td><td class="wide">${seconds(row.scan)}</td>
        <td class="wide">${rules ? `${rules.active}/${rules.rules}` : "–"}</td>
        <td class="wide load">${row.load ? `${row.load[0].toFixed(2)}<br>${row.load[1]} MiB` : "–"}</td>
        <td class="wide">${row.battery == null ? "–" : `${Math.round(100 * row.battery)} %`}</td><td class="wide">${escaped(row.waypoint)}</td></tr>`;
    });
    element("robots").innerHTML = `<table><tr><th>Robot</th><th>State</th><th>m/s</th><th>± m</th><th>Goals</th><th class="wide">Odom</th>
      <th class="wide">Scan</th><th class="wide">Rules</th><th class="wide">CPU</th><th class="wide">Battery</th><th class="wide">Last word</th></tr>${rows.join("")}</table>`;
  }

  function network() {
    const ends = Object.entries(state.network ?? {}), box = element("network"), height = Math.max(120, 34 * ends.length + 20);
    if (!box) return;
    const rows = ends.map(([gateway, one], i) => {
      const y = 24 + 34 * i, fault = of(one.robot, "row")?.fault, bad = one.active < one.rules && fault;
      return `<line x1="120" y1="${height / 2}" x2="250" y2="${y}" stroke="${bad ? "#c10015" : FLEET[one.robot]}" stroke-width="2" ${bad ? 'stroke-dasharray="5"' : ""}/>
        <rect x="250" y="${y - 13}" width="225" height="26" rx="4" fill="none" stroke="${bad ? "#c10015" : FLEET[one.robot]}"/>
        <text x="256" y="${y - 1}">${escaped(gateway)}</text>
        <text x="256" y="${y + 10}">${one.active}/${one.rules} rules, ${one.rate} Hz, ${(one.bytes / 1000).toFixed(0)} kB/s</text>`;
    });
    const idle = (state.rules ?? []).map(rule => `<tr><td>${escaped(rule.gateway)}</td><td>${escaped(rule.name)}</td><td class="bad">${escaped(rule.state)}</td><td>${escaped(rule.reason)}</td></tr>`);
    box.innerHTML = `<svg viewBox="0 0 480 ${height}"><rect x="4" y="${height / 2 - 18}" width="116" height="36" rx="4" fill="none" stroke="currentColor"/>
      <text x="10" y="${height / 2 - 3}">${escaped(state.gateway || "no gateway")}</text><text x="10" y="${height / 2 + 10}">${escaped(state.hub || "no hub")}</text>${rows.join("")}</svg>
      ${idle.length ? `<table><tr><th>Gateway</th><th>Topic</th><th>State</th><th>Reason</th></tr>${idle.join("")}</table>` : "<p>All rules are active.</p>"}`;
  }

  function log() {
    const box = element("log"), levels = ["debug", "info", "warning", "error", "fatal"];
    if (!box) return;
    const wanted = element("filter").value.toLowerCase().split(/\s+/), least = levels.indexOf(element("least").value);
    const found = Object.keys(state).filter(key => key.startsWith("log.") && state[key]).map(key => state[key])
      .filter(entry => levels.indexOf(entry[2]) >= least && wanted.every(word => entry.join(" ").toLowerCase().includes(word)));
    box.innerHTML = found.sort((a, b) => b[0] - a[0]).map(([, stamp, level, computer, node, text]) =>
      `<div class="${escaped(level)}">${stamp.toFixed(1)} <b>${escaped(computer || "base")}</b> ${escaped(node)}: ${escaped(text)}</div>`).join("");
  }

  // ---- user input

  function act(word) {
    const chosen = [...selected], [kind, ...rest] = word.split("-"), what = rest.join("-");
    if (kind === "tool") { tool = what; mark(); }
    else if (word === "stop-all" || word === "release-all") send({ do: kind, robots: names });
    else if (kind === "simulate") send({ do: "simulate", action: what });
    else if (kind === "logout") fetch("/logout", { method: "POST" }).then(() => location.replace("/"));
    else if (kind === "record") send({ do: kind, on: !state.recording });
    else if (kind === "patrol") send({ do: kind, robots: chosen, on: !chosen.every(name => of(name, "row")?.patrols) });
    else if (kind === "follow") { view.follow = !view.follow; mark(); draw(); }
    else if (kind === "fit") { view.follow = false; fit(); mark(); draw(); }
    else send({ do: kind, robots: chosen });
  }

  function mark() {
    for (const button of document.querySelectorAll("[data-act]")) {
      const word = button.dataset.act;
      button.classList.toggle("active", word === `tool-${tool}` || word === "follow" && view.follow
        || word === "patrol" && selected.size > 0 && [...selected].every(name => of(name, "row")?.patrols));
      if (word === "record") button.classList.toggle("recording", Boolean(state.recording));
    }
  }

  function choose(name, more) {
    if (!more) selected = new Set([name]);
    else if (!selected.delete(name)) selected.add(name);
    robots(); mark(); draw();
  }

  function at(event) { const box = canvas().getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; }

  function pressed(event) {
    const [u, v] = at(event);
    if (event.isTrusted) canvas().setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [u, v]);
    const near = names.filter(name => of(name, "pose")).map(name => [Math.hypot(...pixel(...of(name, "pose")).map((p, i) => p - [u, v][i])), name]).sort((a, b) => a[0] - b[0])[0];
    const aims = tool !== "view" && event.button === 0 && pointers.size === 1;
    drag = { from: [u, v], last: [u, v], robot: near && near[0] < 20 ? near[1] : null, place: aims ? metre(u, v) : null, yaw: 0, moved: false };
  }

  function moved(event) {
    if (!drag || !pointers.has(event.pointerId)) return;
    const [u, v] = at(event), before = [...pointers.values()];
    pointers.set(event.pointerId, [u, v]);
    if (pointers.size === 2) {
      const now = [...pointers.values()], length = pair => Math.hypot(pair[0][0] - pair[1][0], pair[0][1] - pair[1][1]);
      zoom(length(now) / Math.max(1, length(before)), ...now[0].map((part, i) => (part + now[1][i]) / 2));
      drag.place = null; drag.moved = true;
    } else if (Math.hypot(u - drag.from[0], v - drag.from[1]) > 6 || drag.moved) {
      drag.moved = true;
      if (drag.place) drag.yaw = Math.atan2(drag.from[1] - v, u - drag.from[0]);
      else { view.x -= (u - drag.last[0]) / view.scale; view.y += (v - drag.last[1]) / view.scale; view.follow = false; mark(); }
    }
    drag.last = [u, v];
    draw();
  }

  function released(event) {
    pointers.delete(event.pointerId);
    if (!drag || pointers.size) return;
    const done = drag;
    drag = null;
    if (!done.place) { if (!done.moved && done.robot) choose(done.robot, event.shiftKey || event.ctrlKey); return draw(); }
    const [x, y] = done.place, place = { x, y, robots: [...selected] };
    if (done.moved) place.yaw = done.yaw;
    if (tool === "spawn") send({ do: "spawn", x, y });
    else send({ ...place, do: tool === "locate" ? "locate" : "drive", append: tool === "append" });
    draw();
  }

  function zoom(by, u, v) {
    const [x, y] = metre(u, v);
    view.scale = Math.min(400, Math.max(2, view.scale * by));
    const [nx, ny] = metre(u, v);
    view.x += x - nx; view.y += y - ny;
  }

  function begin() {
    if (!canvas() || !element("robots")) return requestAnimationFrame(begin);
    const box = canvas();
    laid = true;
    box.addEventListener("pointerdown", pressed);
    box.addEventListener("pointermove", moved);
    box.addEventListener("pointerup", released);
    box.addEventListener("pointercancel", event => { pointers.delete(event.pointerId); drag = null; });
    box.addEventListener("contextmenu", event => event.preventDefault());
    box.addEventListener("wheel", event => { event.preventDefault(); zoom(Math.exp(-event.deltaY / 500), ...at(event)); draw(); }, { passive: false });
    new ResizeObserver(() => requestAnimationFrame(draw)).observe(box);
    document.addEventListener("click", event => {
      const button = event.target.closest("[data-act]"), row = event.target.closest("[data-robot]");
      if (button) act(button.dataset.act);
      else if (row) choose(row.dataset.robot, event.shiftKey || event.ctrlKey);
      else setTimeout(() => { network(); log(); }, 300);
    });
    document.addEventListener("input", event => ["filter", "least"].includes(event.target.id) && log());
    document.querySelector("#replay input").addEventListener("change", event => {
      trails.clear();
      send({ do: "seek", at: Number(event.target.value) });
    });
    window.fleetPage = { state, pixel, view, metre, shown: () => shown, labels: () => labels };
    mark();
    if (drawn) { words(state); draw(); }
  }
  // Connect first: the rest of the page takes longer to load.
  connect();
  begin();
})();
