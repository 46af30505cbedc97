/** The robot from above: its body, and wheels that turn and steer. */

import { palette } from "./palette.js";

const TREADS = 10;

/** Traces a polygon. */
export function trace(context, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.closePath();
}

/**
 * Draws a robot in metres.
 * @param context     in world coordinates
 * @param pixel       m a pixel, so that lines keep their width
 * @param outline     corners of the footprint, body frame
 * @param pose        {x, y, theta}
 * @param wheels      the drive's wheels (wheels.js)
 * @param wheelAt     name → {turned, steered}, rad
 */
export function drawRobot(context, pixel, outline, pose, wheels, wheelAt) {
  context.save();
  context.translate(pose.x, pose.y);
  context.rotate(pose.theta);
  trace(context, outline);
  context.fillStyle = palette.css.body;
  context.fill();
  context.strokeStyle = palette.css.accent;
  context.lineWidth = 1.8 * pixel;
  context.lineJoin = "round";
  context.stroke();
  nose(context, outline, pixel);
  const length = Math.max(...outline.map((p) => p[0])) - Math.min(...outline.map((p) => p[0]));
  for (const wheel of wheels) {
    const { turned, steered } = wheelAt(wheel.name);
    context.save();
    context.translate(wheel.x, wheel.y);
    context.rotate(wheel.heading + steered);
    if (wheel.trail) arm(context, wheel, pixel);
    if (wheel.track) drawTrack(context, wheel, turned, 0.8 * length, pixel);
    else drawWheel(context, wheel, turned, pixel);
    context.restore();
  }
  context.restore();
}

/** A chevron where the front is. */
function nose(context, outline, pixel) {
  const front = Math.max(...outline.map((p) => p[0]));
  const size = Math.max(0.05 * front, Math.min(0.16 * front, 9 * pixel));
  context.beginPath();
  context.moveTo(front - 2.2 * size, size);
  context.lineTo(front - 1.2 * size, 0);
  context.lineTo(front - 2.2 * size, -size);
  context.stroke();
}

function arm(context, wheel, pixel) {
  context.strokeStyle = palette.css.tyre;
  context.lineWidth = Math.max(1.5 * pixel, 0.12 * wheel.radius);
  context.beginPath();
  context.moveTo(0, 0);
  context.lineTo(-wheel.trail, 0);
  context.stroke();
  context.beginPath();
  context.arc(0, 0, Math.max(2 * pixel, 0.14 * wheel.radius), 0, 7);
  context.fillStyle = palette.css.accent;
  context.fill();
  context.translate(-wheel.trail, 0);
}

/** One sees the top of a wheel: its treads move forward where it rolls forward, and vanish over the rim. */
function drawWheel(context, { radius, roller }, turned, pixel) {
  const half = 0.32 * radius;
  tyre(context, radius, half);
  context.strokeStyle = palette.css.tread;
  context.lineWidth = Math.max(0.8 * pixel, 0.07 * radius);
  context.beginPath();
  for (let k = 0; k < TREADS; k++) {
    const angle = turned + (2 * Math.PI * k) / TREADS;
    const high = Math.cos(angle);
    if (high < 0.12) continue;
    const along = radius * Math.sin(angle);
    const lean = roller === undefined ? Math.PI / 2 : roller;
    tread(context, along, half * 0.8, lean, radius * 0.22 * high);
  }
  context.stroke();
}

/** A line across the wheel, or a roller in the direction `lean`, as long as it looks from above. */
function tread(context, along, half, lean, short) {
  const c = Math.cos(lean),
    s = Math.sin(lean);
  const reach = Math.abs(s) > 0.3 ? half / Math.abs(s) : short;
  context.moveTo(along - reach * c, -reach * s);
  context.lineTo(along + reach * c, reach * s);
}

function drawTrack(context, { radius }, turned, length, pixel) {
  const half = 0.45 * radius,
    end = length / 2;
  tyre(context, end, half);
  const pitch = 0.5 * radius;
  context.strokeStyle = palette.css.tread;
  context.lineWidth = Math.max(0.8 * pixel, 0.07 * radius);
  context.beginPath();
  const first = ((((turned * radius) % pitch) + pitch) % pitch) - end;
  for (let along = first; along < end; along += pitch) {
    context.moveTo(along, -0.8 * half);
    context.lineTo(along, 0.8 * half);
  }
  context.stroke();
}

function tyre(context, end, half) {
  context.beginPath();
  context.roundRect(-end, -half, 2 * end, 2 * half, Math.min(half, 0.3 * end));
  context.fillStyle = palette.css.tyre;
  context.fill();
}
