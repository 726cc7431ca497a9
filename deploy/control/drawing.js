// How things are drawn: marks by their shapes, in a pen's own pixels; nothing here knows of the run.
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const FULL = 2 * Math.PI;

function line(pen, points) {
  pen.beginPath();
  points.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  pen.stroke();
}
function ring(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, Math.max(1, radius), 0, FULL);
  pen.stroke();
}
function disc(pen, x, y, radius) {
  pen.beginPath();
  pen.arc(x, y, Math.max(1, radius), 0, FULL);
  pen.fill();
}
function across(pen, x, y, size) {
  line(pen, [[x - size, y - size], [x + size, y + size]]);
  line(pen, [[x - size, y + size], [x + size, y - size]]);
}
function dashed(pen, dashes, draws) {
  pen.setLineDash(dashes);
  draws();
  pen.setLineDash([]);
}
// Marks of one point: of places, and around robots. `size`: a radius in pixels.
const MARKS = {
  ring: (pen, x, y, size) => ring(pen, x, y, size),
  disc: (pen, x, y, size) => disc(pen, x, y, size),
  "dim disc": (pen, x, y, size) => { pen.globalAlpha *= 0.55; disc(pen, x, y, size * 0.6); },
  cross: (pen, x, y, size) => across(pen, x, y, size * 0.9),
diamond: (pen, x, y, size) => line(pen, [[x, y - size * 1.3], [x + size * 1.3, y], [x, y + size * 1.3], [x - size * 1.3, y], [x, y - size * 1.3]]),
  blocked: (pen, x, y, size) => { pen.lineWidth = 3; ring(pen, x, y, size); },
  "heavy cross": (pen, x, y, size) => { pen.lineWidth = 4; across(pen, x, y, size * 0.9); },
  snowflake: (pen, x, y, size) => {
    for (const turn of [0, 1, 2]) {
      const [dx, dy] = [Math.cos((turn * Math.PI) / 3) * size, Math.sin((turn * Math.PI) / 3) * size];
      line(pen, [[x - dx, y - dy], [x + dx, y + dy]]);
    }
  },
  "dashed ring": (pen, x, y, size) => dashed(pen, [6, 4], () => ring(pen, x, y, size)),
};
// Marks of more points.
const LINES = {
  tint: (pen, points, width) => {
    pen.lineWidth = Math.max(4, width);
    pen.globalAlpha *= 0.7;
    line(pen, points);
    [pen.strokeStyle, pen.lineWidth, pen.globalAlpha] = [css("--ink"), 1, 1];
    dashed(pen, [3, 3], () => line(pen, points));
  },
  bar: (pen, points, width) => { // with an edge that is seen on light and dark
    const own = pen.strokeStyle;
    [pen.strokeStyle, pen.lineWidth] = [css("--ink"), Math.max(5, width) + 2];
    line(pen, points);
    [pen.strokeStyle, pen.lineWidth] = [own, Math.max(5, width)];
    line(pen, points);
  },
  beam: (pen, points) => { pen.lineWidth = 4; line(pen, points); },
  trail: (pen, points) => { pen.lineWidth = 2; pen.globalAlpha *= 0.55; line(pen, points); },
  dashes: (pen, points) => { pen.lineWidth = 1.5; dashed(pen, [2, 4], () => line(pen, points)); },
  link: (pen, points) => { pen.lineWidth = 1; pen.globalAlpha *= 0.45; line(pen, points); },
};
function mark(pen, shape, colour, x, y, size) {
  pen.save();
  pen.strokeStyle = pen.fillStyle = colour;
  pen.lineWidth = 2;
  MARKS[shape](pen, x, y, size);
  pen.restore();
}
function stretch(pen, shape, colour, points, width = 3) {
  pen.save();
  pen.strokeStyle = colour;
  LINES[shape](pen, points, width);
  pen.restore();
}
function word(pen, text, x, y) {
  pen.save();
  pen.font = "13px system-ui, sans-serif";
  pen.lineWidth = 3;
  pen.lineJoin = "round";
  pen.strokeStyle = css("--ground");
  pen.fillStyle = css("--ink");
  pen.strokeText(text, x, y);
  pen.fillText(text, x, y);
  pen.restore();
}
function tinted(image, tint) {
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [image.width, image.height];
  const brush = copy.getContext("2d");
  brush.drawImage(image, 0, 0);
  brush.globalCompositeOperation = "source-in";
  brush.fillStyle = tint;
  brush.fillRect(0, 0, copy.width, copy.height);
  return copy;
}
function fitted(canvas) { // a pen whose unit is a pixel of the page
  const ratio = devicePixelRatio || 1, pen = canvas.getContext("2d");
  const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
  if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  return pen;
}
// One entry of the legend, in a small canvas of its own.
function sample(canvas, shape, colour) {
  const pen = fitted(canvas);
  pen.clearRect(0, 0, 36, 22);
  if (shape in LINES) stretch(pen, shape, colour, [[4, 11], [32, 11]], 5);
  else mark(pen, shape, colour, 18, 11, 7);
}
