/** What does not move: the floor with what stands on it, and a plan's path and swept footprints. */

import { corners, inside, placed } from "./geometry.js";
import { hits, mapCorners, picture, summary } from "./maps.js";
import { mixed, palette } from "./palette.js";
import { trace } from "./robot.js";
import { state } from "./state.js";

const SWEPT = 400;
const OUTLINES = 40;
const SHADES = 12;

/** The floor: bounds, grid, map, obstacles. `context` is in metres, `pixel` m a pixel. */
export function drawWorld(context, camera, pixel) {
  const { environment } = state.request;
  const map = summary();
  const box = environment.bounds;
  const floor = box ? rectangle(box) : map ? mapCorners(map) : null;
  if (floor) {
    trace(context, floor);
    context.fillStyle = palette.css.floor;
    context.fill();
  }
  drawGrid(context, camera, pixel);
  if (map) drawMap(context, map);
  (environment.obstacles ?? []).forEach((obstacle, i) => drawObstacle(context, obstacle, i, pixel));
  if (floor) {
    trace(context, floor);
    context.strokeStyle = state.problem?.code?.endsWith("out-of-bounds") ? palette.css.bad : palette.css.edge;
    context.lineWidth = 1.5 * pixel;
    context.stroke();
  }
}

export function rectangle({ x_min, y_min, x_max, y_max }) {
  return [
    [x_min, y_min],
    [x_max, y_min],
    [x_max, y_max],
    [x_min, y_max],
  ];
}

/** The grid's step: 1, 2 or 5 times a power of ten, some 50 pixels or more. */
export function gridStep(camera) {
  const least = 50 / camera.scale;
  const power = 10 ** Math.floor(Math.log10(least));
  return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= least);
}

function drawGrid(context, camera, pixel) {
  const step = gridStep(camera);
  const [x0, y1] = camera.toWorld([0, 0]),
    [x1, y0] = camera.toWorld([camera.width, camera.height]);
  context.beginPath();
  for (let x = Math.ceil(x0 / step) * step; x <= x1; x += step)
    (context.moveTo(x, y0), context.lineTo(x, y1));
  for (let y = Math.ceil(y0 / step) * step; y <= y1; y += step)
    (context.moveTo(x0, y), context.lineTo(x1, y));
  context.strokeStyle = palette.css.grid;
  context.lineWidth = pixel;
  context.stroke();
}

function drawMap(context, map) {
  const image = picture(map);
  if (!image) return;
  const [x, y, theta] = map.origin;
  context.save();
  context.translate(x, y);
  context.rotate(theta);
  context.scale(map.resolution, -map.resolution);
  context.imageSmoothingEnabled = false;
  context.drawImage(image, 0, -map.height);
  context.restore();
}

function drawObstacle(context, obstacle, i, pixel) {
  const hit = state.problem?.hit === i;
  const selected = state.selected === i;
  trace(context, corners(obstacle));
  context.fillStyle = palette.css.solid;
  context.fill();
  if (hit) {
    context.globalAlpha = 0.45;
    context.fillStyle = palette.css.bad;
    context.fill();
    context.globalAlpha = 1;
  }
  context.strokeStyle = palette.css[hit ? "bad" : selected ? "accent" : "solid-edge"];
  context.lineWidth = (hit || selected ? 2.2 : 1.1) * pixel;
  context.lineJoin = "round";
  context.stroke();
}

/** The map's cells that a footprint, a polygon in the world, overlaps. */
export function drawHits(context, polygon) {
  const map = summary();
  if (!map) return;
  const [x, y, theta] = map.origin;
  context.save();
  context.translate(x, y);
  context.rotate(theta);
  context.scale(map.resolution, map.resolution);
  context.fillStyle = palette.css.bad;
  for (const [column, row] of hits(map, polygon, inside)) context.fillRect(column, row, 1, 1);
  context.restore();
}

/** What the footprint sweeps, outlines of it, and the path of the body origin, darker where it is faster. */
export function drawMotion(context, motion, pixel, scratch) {
  drawSwept(context, motion, scratch);
  context.globalAlpha = state.stale ? 0.35 : 1;
  drawOutlines(context, motion, pixel);
  drawPath(context, motion, pixel);
  context.globalAlpha = 1;
}

/** Filled opaque on a canvas of its own, then laid over in one tone: overlaps do not show. */
function drawSwept(context, motion, scratch) {
  const { canvas } = context;
  if (scratch.width !== canvas.width || scratch.height !== canvas.height) {
    scratch.width = canvas.width;
    scratch.height = canvas.height;
  }
  const over = scratch.getContext("2d");
  over.setTransform(1, 0, 0, 1, 0, 0);
  over.clearRect(0, 0, scratch.width, scratch.height);
  over.setTransform(context.getTransform());
  over.fillStyle = palette.css.accent;
  over.beginPath();
  for (const i of spread(motion, SWEPT)) {
    placed(motion.outline, motion.sample(i)).forEach(([x, y], k) =>
      k ? over.lineTo(x, y) : over.moveTo(x, y),
    );
    over.closePath();
  }
  over.fill("nonzero");
  context.save();
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.globalAlpha = state.stale ? 0.05 : 0.11;
  context.drawImage(scratch, 0, 0);
  context.restore();
}

function drawOutlines(context, motion, pixel) {
  context.strokeStyle = palette.css.accent;
  context.lineWidth = 0.9 * pixel;
  const alpha = context.globalAlpha;
  context.globalAlpha = 0.28 * alpha;
  for (const i of spread(motion, OUTLINES)) {
    trace(context, placed(motion.outline, motion.sample(i)));
    context.stroke();
  }
  context.globalAlpha = alpha;
}

/** Samples evenly along the way that the footprint's rim travels, at most `most`, first and last among them. */
function spread({ way }, most) {
  const step = way.at(-1) / (most - 1);
  const found = [0];
  for (let i = 1; i < way.length; i++) if (way[i] >= found.length * step - 1e-9) found.push(i);
  return found;
}

function drawPath(context, motion, pixel) {
  const { x, y, vx, vy } = motion.pose;
  const n = motion.samples;
  let top = 1e-9;
  for (let i = 0; i < n; i++) top = Math.max(top, Math.hypot(vx[i], vy[i]));
  context.lineWidth = 2.6 * pixel;
  context.lineCap = context.lineJoin = "round";
  // Faded, the path is of one tone: the ends of its pieces would show where they overlap.
  const shade = state.stale
    ? () => SHADES - 1
    : (i) => Math.min(SHADES - 1, Math.floor((SHADES * Math.hypot(vx[i], vy[i])) / top));
  for (let from = 0; from < n - 1;) {
    const tone = shade(from);
    context.beginPath();
    context.moveTo(x[from], y[from]);
    let i = from + 1;
    while (i < n - 1 && shade(i) === tone) (context.lineTo(x[i], y[i]), i++);
    context.lineTo(x[i], y[i]);
    context.strokeStyle = mixed("slow", "fast", tone / (SHADES - 1));
    context.stroke();
    from = i;
  }
}
