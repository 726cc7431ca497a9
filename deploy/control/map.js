// View and drawing of the map. Points are in m on the floor, or in pixels.
const $ = (id) => document.getElementById(id), css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const canvas = $("map"), pen = canvas.getContext("2d"), trails = new Map();
const TRAIL_S = 20, TRAIL_STEP_S = 0.5, JUMP = 1.5, FARTHEST = 1, CLOSEST = 40, DOOR_M = 1;
let floor = null, state = null, walls = null, chosen = null, asked = 0;
let scale = 1, left = 0, top_ = 0, sight = { zoom: 1, x: 0, y: 0 };
// Marks by shape. Arguments: pen with the mark's colour; points, radius or width in pixels.
function line(pen, points) {
  pen.beginPath();
  points.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
}
function round(pen, [[x, y]], size, how = "stroke") {
  pen.beginPath();
  pen.arc(x, y, Math.max(1, size), 0, 2 * Math.PI);
  pen[how]();
}
function star(pen, [[x, y]], size, angles) {
  for (const [dx, dy] of angles.map((one) => [Math.cos(one) * size, Math.sin(one) * size])) line(pen, [[x - dx, y - dy], [x + dx, y + dy]]);
}
const polygon = (pen, [[x, y]], size, corners) => line(pen, [...corners, corners[0]].map(([dx, dy]) => [x + dx * size, y + dy * size]));
const SHAPES = {
  ring: round,
  disc: (pen, at, size) => round(pen, at, size, "fill"),
  cross: (pen, at, size) => star(pen, at, size * 1.27, [Math.PI / 4, -Math.PI / 4]),
  "heavy cross": (pen, at, size) => { pen.lineWidth = 4; SHAPES.cross(pen, at, size); },
  diamond: (pen, at, size) => polygon(pen, at, size * 1.3, [[0, -1], [1, 0], [0, 1], [-1, 0]]),
  square: (pen, at, size) => polygon(pen, at, size, [[-1, -1], [1, -1], [1, 1], [-1, 1]]),
  triangle: (pen, at, size) => polygon(pen, at, size, [[-1, -1], [1, -1], [0, 1]]),
  tick: (pen, at, size) => star(pen, at, size, [Math.PI / 2]),
  snowflake: (pen, at, size) => star(pen, at, size, [0, Math.PI / 3, (2 * Math.PI) / 3]),
  blocked: (pen, at, size) => { pen.lineWidth = 3; round(pen, at, size); },
  "dashed ring": (pen, at, size) => { pen.setLineDash([6, 4]); round(pen, at, size); },
  tint: (pen, points, width) => {
    Object.assign(pen, { lineWidth: Math.max(4, width), globalAlpha: 0.7 });
    line(pen, points);
    Object.assign(pen, { strokeStyle: css("--ink"), lineWidth: 1, globalAlpha: 1 }).setLineDash([3, 3]);
    line(pen, points);
  },
  bar: (pen, points, width) => { // with an edge visible on light and dark
    const own = pen.strokeStyle;
    for (const [tint, edge] of [[css("--ink"), 2], [own, 0]]) {
      [pen.strokeStyle, pen.lineWidth] = [tint, Math.max(5, width) + edge];
      line(pen, points);
    }
  },
  "filled ring": (pen, at, size) => { round(pen, at, size); pen.globalAlpha *= 0.4; round(pen, at, size, "fill"); },
  "soft ring": (pen, at, size) => SHAPES["filled ring"](pen, at, size),
  beam: (pen, points) => { pen.lineWidth = 4; line(pen, points); },
  trail: (pen, points) => { pen.globalAlpha *= 0.55; line(pen, points); },
  dashes: (pen, points) => { pen.lineWidth = 1.5; pen.setLineDash([2, 4]); line(pen, points); },
  link: (pen, points) => { pen.lineWidth = 1; pen.globalAlpha *= 0.45; line(pen, points); },
};
function mark(pen, shape, colour, points, size = 3, alpha = 1) {
  pen.save();
  Object.assign(pen, { strokeStyle: colour, fillStyle: colour, lineWidth: 2, globalAlpha: alpha });
  SHAPES[shape](pen, points, size);
  pen.restore();
}
function word(text, x, y) {
  pen.save();
  Object.assign(pen, { font: "13px system-ui, sans-serif", lineWidth: 3, lineJoin: "round", strokeStyle: css("--ground"), fillStyle: css("--ink") });
  pen.strokeText(text, x, y);
  pen.fillText(text, x, y);
  pen.restore();
}
function fitted(canvas) { // returns its pen, in page pixels
  const ratio = devicePixelRatio || 1, own = canvas.getContext("2d");
  const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  own.setTransform(ratio, 0, 0, ratio, 0, 0);
  return own;
}
const toScreen = (x, y) => [left + (x - floor.west) * scale, top_ + (floor.south + floor.height - y) * scale];
const toFloor = (px, py) => [floor.west + (px - left) / scale, floor.south + floor.height - (py - top_) / scale];
const colour = (...ids) => floor.robots[ids.find((id) => id in floor.robots)]?.colour || css("--ink");
const robotOf = (id) => (state ? state.robots.find(([own]) => own === id) : undefined);
const goes = (word_) => word_ !== "off" && word_ !== "frozen";
const middleOf = ([[ax, ay], [bx, by]]) => [(ax + bx) / 2, (ay + by) / 2];
const isShut = (door) => state.things.some(([kind, points]) => kind.endsWith("door") && Math.hypot(...middleOf(points).map((one, axis) => one - middleOf(door)[axis])) < 0.5);
function loadFloor(message) {
  floor = message;
  for (const [id, trail] of Object.entries(floor.trails)) trails.set(id, trail);
  sight = { zoom: 1, x: floor.west + floor.width / 2, y: floor.south + floor.height / 2 };
  const image = Object.assign(new Image(), { src: `data:image/png;base64,${floor.png}` });
  image.onload = () => { walls = image; redraw(); };
}
function fit() {
  fitted(canvas);
  const { clientWidth: w, clientHeight: h } = canvas;
  scale = 0.96 * Math.min(w / floor.width, h / floor.height) * sight.zoom;
  left = w / 2 - (sight.x - floor.west) * scale;
  top_ = h / 2 - (floor.south + floor.height - sight.y) * scale;
}
function look(x, y, zoom) {
  const within = (value, begin, size) => { // the whole floor is centred
    const [centre, free] = [begin + size / 2, (size * (1 - 1 / zoom)) / 2];
    return Math.min(centre + free, Math.max(centre - free, value));
  };
  sight = { zoom, x: within(x, floor.west, floor.width), y: within(y, floor.south, floor.height) };
  redraw();
}
function zoomBy(factor, px = canvas.clientWidth / 2, py = canvas.clientHeight / 2) {
  if (!floor) return;
  fit();
  const [x, y] = toFloor(px, py), zoom = Math.min(CLOSEST, Math.max(FARTHEST, sight.zoom * factor));
  const kept = sight.zoom / zoom; // keep the point under the pointer
  look(x + (sight.x - x) * kept, y + (sight.y - y) * kept, zoom);
}
const panBy = (dx, dy) => { if (floor) { fit(); look(sight.x - dx / scale, sight.y + dy / scale, sight.zoom); } };
function reveal(x, y) { // keep objects moved by keys in view
  fit();
  const [px, py] = toScreen(x, y), { clientWidth: w, clientHeight: h } = canvas;
  if (px < 20 || py < 20 || px > w - 20 || py > h - 20) look(x, y, sight.zoom);
}
function remember() { // extend trails, whose start came with the floor
  for (const [id, x, y] of state.robots) {
    const trail = trails.get(id) || [];
    if (!trail.length || state.t - trail[trail.length - 1][0] >= TRAIL_STEP_S) trail.push([state.t, x, y]);
    while (trail.length && state.t - trail[0][0] > TRAIL_S) trail.shift();
    trails.set(id, trail);
  }
}
const redraw = () => { if (!asked) asked = requestAnimationFrame(() => { asked = 0; draw(); }); };
function draw() {
  if (!floor || !state) return;
  fit();
  const ink = css("--ink"), size = Math.min(9, Math.max(4, 0.18 * scale));
  const put = (name, points, more = {}) => {
    const [shape, tint] = floor.legend[name], at = points.map((one) => toScreen(...one));
    mark(pen, shape, more.colour || tint || ink, at, more.size, more.alpha);
    return at;
  };
  pen.clearRect(0, 0, canvas.clientWidth, canvas.clientHeight);
  pen.imageSmoothingEnabled = false;
  if (walls) { // the image is a mask for the wall colour
    pen.drawImage(walls, ...toScreen(floor.west, floor.south + floor.height), floor.width * scale, floor.height * scale);
    Object.assign(pen, { globalCompositeOperation: "source-in", fillStyle: css("--wall") });
    pen.fillRect(0, 0, canvas.clientWidth, canvas.clientHeight);
    pen.globalCompositeOperation = "source-over";
  }
  const at = state.robots.map(([, x, y]) => [x, y]);
  for (const [one, other] of state.links) put("link", [at[one], at[other]]);
  for (const [owner, x, y, stands, by] of state.items) {
    const [shape] = floor.marks[stands] || [], full = shape === "disc", at = [toScreen(x, y)];
    const [far, alpha] = full && !floor.open.includes(stands) ? [size * 0.6, 0.55] : [size, 1];
    if (full) mark(pen, "disc", colour(by, owner), at, far, alpha);
    if (shape) mark(pen, full ? "ring" : shape, colour(owner, by), at, far, alpha);
  }
  for (const one of floor.doors) if (!isShut(one)) put("door", one, { size: 0.2 * scale });
  for (const [kind, points, radius, left_] of state.things) {
    const straight = points.length > 1, name = kind === "closing door" ? "closed door" : kind;
    const ends = put(name, points, { size: (straight ? 2 : 1) * radius * scale, alpha: name === kind ? 1 : 0.5 });
    if (straight && kind !== "wall") word(kind === name ? "closed" : "closing", ends[1][0] + 6, ends[1][1] - 6);
    if (left_) word(`jammer, ${left_.toFixed(0)} s left`, ...toScreen(points[0][0] - radius, points[0][1] + radius));
  }
  for (const [id, x, y, , , heads, blocker] of state.robots) {
    const parts = [[]];
    for (const [, tx, ty] of [...(trails.get(id) || []), [0, x, y]]) {
      const last = parts[parts.length - 1].at(-1);
      if (last && Math.hypot(last[0] - tx, last[1] - ty) > JUMP) parts.push([]); // the robot was carried
      parts[parts.length - 1].push([tx, ty]);
    }
    for (const one of parts) put("trail", one, { colour: colour(id) });
    if (heads) put("destination", [[x, y], heads], { colour: colour(id) });
    const other = robotOf(blocker);
    if (other) mark(pen, "beam", floor.legend.blocked[1], [toScreen(x, y), toScreen(other[1], other[2])]);
  }
  for (const at of state.people) put("person", [at], { size: floor.person * scale });
  for (const [id, x, y, heading, stands, , blocker] of state.robots) {
    const [px, py] = toScreen(x, y), own = Math.max(4, floor.robots[id].radius * scale), alpha = goes(stands) ? 1 : 0.45;
    mark(pen, "disc", colour(id), [[px, py]], own, alpha);
    mark(pen, "beam", "#fff", [[px, py], [px + Math.cos(heading) * own, py - Math.sin(heading) * own]], 0, alpha);
    if (stands in floor.legend) put(stands, [[x, y]], { size: goes(stands) ? own + 3 : own });
    if (id === chosen) mark(pen, "ring", ink, [[px, py]], own + 6);
    const words = { driving: "", blocked: ` blocked by ${blocker}` }[stands] ?? ` ${stands}`;
    if (state.robots.length <= 30 || id === chosen || sight.zoom > 2) word(id + words, px + own + 4, py - own);
  }
  drawHand();
}
function drawLegend() { // each mark in its own small canvas, as in `draw`
  if (!floor) return;
  const entries = [...Object.entries(floor.marks), ...Object.entries(floor.legend)], list = $("legend");
  if (!list.children.length) list.innerHTML = "<li><canvas aria-hidden='true'></canvas></li>".repeat(entries.length);
  entries.forEach(([name, [shape, tint, says]], index) => {
    const item = list.children[index], own = fitted(item.firstChild);
    if (item.childNodes.length === 1) item.append(says);
    own.clearRect(0, 0, 36, 22);
    const inked = ["link", "frozen", "off"].includes(name), straight = ["tint", "bar", "trail", "dashes", "link"].includes(shape);
    mark(own, shape, tint || (inked ? css("--ink") : Object.values(floor.robots)[0].colour), straight ? [[4, 11], [32, 11]] : [[18, 11]], straight ? 5 : 7);
  });
}
