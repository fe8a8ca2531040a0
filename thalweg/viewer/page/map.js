// The map with the track, and the chart of return and costs: drawn from plain data, in metres and steps.

const MARGIN_M = 8, NEAR_M = 45, ARROW_PX = 9;
const PROP_COLOURS = ["", "#eb5a3c", "#f0a028", "#e8d024", "#be50be"]; // by kind: swimmer, kayak, buoy, station

const colours = new Map();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => colours.clear());

/** A colour of the style sheet, which is slow to ask for. */
function colour(name) {
  if (!colours.has(name)) {
    colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  }
  return colours.get(name);
}

/** A canvas with as many pixels as the screen shows of it; returns its context, width and height in CSS pixels. */
function sharp(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth;
  const height = Math.round((width * Number(canvas.dataset.height)) / Number(canvas.dataset.width));
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [context, width, height];
}

function keepShape(canvas) {
  canvas.dataset.width = canvas.width;
  canvas.dataset.height = canvas.height;
}

export class RiverMap {
  constructor(canvas) {
    this.canvas = canvas;
    keepShape(canvas);
    this.near = false;
    this.river = null;
    this.track = [];
  }

  begin(river) {
    this.river = river;
    this.track = [];
  }

  /** Draw the map with the vehicle at a pose [x, y, z, yaw], and objects [[kind, x, y], ...]. */
  draw(pose, props) {
    if (!this.river) return;
    const last = this.track.at(-1);
    if (!last || Math.hypot(pose[0] - last[0], pose[1] - last[1]) > 0.3) this.track.push([pose[0], pose[1]]);
    const [context, width, height] = sharp(this.canvas);
    const place = this.near ? around(pose, width, height) : whole(this.river, width, height);
    const path = pathOn(context, place);
    context.clearRect(0, 0, width, height);
    if (this.near) this.drawRiver(context, path);
    else context.drawImage(this.wholeRiver(place, width, height), 0, 0, width, height);
    context.strokeStyle = colour("track");
    context.lineWidth = 2;
    context.lineJoin = "round";
    path(this.track, false);
    context.stroke();
    for (const [kind, x, y] of props) dot(context, place.at([x, y]), PROP_COLOURS[kind]);
    dot(context, place.at(this.track[0]), colour("good"));
    arrow(context, place.at(pose), pose[3]);
    scaleBar(context, place.scale, height);
  }

  /** The whole river as a picture, which is drawn anew for another river, size or set of colours. */
  wholeRiver(place, width, height) {
    const key = [this.canvas.width, this.canvas.height, colour("water")].join();
    if (this.river.key !== key) {
      const picture = document.createElement("canvas");
      picture.width = this.canvas.width;
      picture.height = this.canvas.height;
      const context = picture.getContext("2d");
      context.scale(picture.width / width, picture.height / height);
      this.drawRiver(context, pathOn(context, place));
      this.river.key = key;
      this.river.picture = picture;
    }
    return this.river.picture;
  }

  drawRiver(context, path) {
    const { left, right, closed, islands, bridges, centre } = this.river;
    context.fillStyle = colour("water");
    this.fillStrips(context, path, left, right, closed);
    context.strokeStyle = colour("soft");
    context.globalAlpha = 0.45;
    context.lineWidth = 0.8;
    context.setLineDash([4, 5]);
    path(centre, closed);
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
    context.fillStyle = colour("island");
    for (const island of islands) { path(island, true); context.fill(); }
    context.fillStyle = colour("bridge");
    for (const bridge of bridges) { path(bridge, true); context.fill(); }
  }

  /** Fill the river as one strip for each segment: banks may cross where it bends. */
  fillStrips(context, path, left, right, closed) {
    context.strokeStyle = colour("water");
    context.lineWidth = 1;
    const count = left.length - (closed ? 0 : 1);
    for (let index = 0; index < count; index += 1) {
      const next = (index + 1) % left.length;
      path([left[index], left[next], right[next], right[index]], true);
      context.fill();
      context.stroke();
    }
  }
}

/** A function that makes lines of points in metres the path of a context. */
function pathOn(context, place) {
  return (points, closed) => {
    context.beginPath();
    points.forEach((point, index) => context[index ? "lineTo" : "moveTo"](...place.at(point)));
    if (closed) context.closePath();
  };
}

/** Where the whole river is on the canvas. */
function whole(river, width, height) {
  if (!river.box) {
    const points = [...river.left, ...river.right], xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
    river.box = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  }
  const [west, east, south, north] = river.box;
  const scale = Math.min(width / (east - west + 2 * MARGIN_M), height / (north - south + 2 * MARGIN_M));
  return placed((west + east) / 2, (south + north) / 2, scale, width, height);
}

function around(pose, width, height) {
  return placed(pose[0], pose[1], Math.min(width, height) / (2 * NEAR_M), width, height);
}

function placed(x, y, scale, width, height) {
  return { scale, at: (point) => [width / 2 + (point[0] - x) * scale, height / 2 - (point[1] - y) * scale] };
}

function dot(context, [x, y], fill) {
  context.fillStyle = fill;
  context.beginPath();
  context.arc(x, y, 3.5, 0, 2 * Math.PI);
  context.fill();
}

function arrow(context, [x, y], yaw) {
  context.beginPath();
  for (const turn of [0, 2.5, -2.5]) {
    context.lineTo(x + ARROW_PX * Math.cos(yaw + turn), y - ARROW_PX * Math.sin(yaw + turn));
  }
  context.closePath();
  context.fillStyle = colour("bad");
  context.strokeStyle = colour("panel");
  context.lineWidth = 1.5;
  context.fill();
  context.stroke();
}

function scaleBar(context, scale, height) {
  const metres = [5, 10, 20, 50, 100, 200, 500, 1000].find((each) => each * scale > 40) || 2000;
  context.fillStyle = context.strokeStyle = colour("ink");
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(10, height - 10);
  context.lineTo(10 + metres * scale, height - 10);
  context.stroke();
  context.font = "11px system-ui, sans-serif";
  context.fillText(`${metres} m`, 14 + metres * scale, height - 6);
}

/** The return and the sum of costs over the steps of a flight. */
export class Chart {
  constructor(canvas) {
    this.canvas = canvas;
    keepShape(canvas);
    this.begin();
  }

  begin() {
    this.points = [[0, 0, 0]];
  }

  add(step, returned, cost) {
    const last = this.points.at(-1);
    if (step === last[0]) this.points[this.points.length - 1] = [step, returned, cost];
    else if (step > last[0]) this.points.push([step, returned, cost]);
  }

  draw(maxSteps) {
    const [context, width, height] = sharp(this.canvas);
    context.clearRect(0, 0, width, height);
    const last = this.points.at(-1), steps = Math.max(last[0], Math.min(maxSteps, 50));
    const top = (column) => Math.max(...this.points.map((point) => point[column]), 1);
    const line = (column, stroke, label) => {
      const most = top(column);
      context.strokeStyle = context.fillStyle = stroke;
      context.lineWidth = 1.6;
      context.beginPath();
      for (const point of this.points) {
        context.lineTo(4 + (point[0] / steps) * (width - 8), height - 6 - (point[column] / most) * (height - 26));
      }
      context.stroke();
      context.font = "11px system-ui, sans-serif";
      context.textAlign = column === 1 ? "left" : "right";
      context.fillText(`${label}, to ${most < 10 ? most.toFixed(1) : most.toFixed(0)}`, column === 1 ? 4 : width - 4, 11);
    };
    context.strokeStyle = colour("line");
    context.strokeRect(0.5, 15.5, width - 1, height - 17);
    line(1, colour("accent"), "return");
    line(2, colour("bad"), "cost");
  }
}
