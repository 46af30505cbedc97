/**
 * Each wheel's rate, acceleration and steering angle against its limits. A chart is drawn once for a plan; while
 * it plays only the cursor moves and the figures change.
 */

import { byId, element } from "./dom.js";
import { fixed, short, words } from "./format.js";
import { at } from "./motion.js";
import { palette, seriesColour } from "./palette.js";
import { pause, player, seek } from "./player.js";
import { on, state } from "./state.js";

const KINDS = [
  { title: "Wheel rate", unit: "rad/s", limit: "wheel_speed", of: (wheel) => wheel.velocity },
  {
    title: "Wheel acceleration",
    unit: "rad/s²",
    limit: "wheel_acceleration",
    of: (wheel) => wheel.acceleration,
  },
  { title: "Steering angle", unit: "rad", limit: "steering_angle", of: (wheel) => wheel.steering?.angle },
];
const PAD = { left: 40, right: 10, top: 8, bottom: 20 };

let charts = [];
let observer = null;

export function startCharts() {
  observer = new ResizeObserver(() => charts.forEach(draw));
  on("motion", make);
  on("theme", () => charts.forEach(draw));
  on("time", follow);
}

/** A chart for each kind that this drive has. */
function make() {
  observer.disconnect();
  const { motion } = state;
  if (!motion) return;
  charts = KINDS.map((kind) => chart(kind, motion)).filter(Boolean);
  byId("charts").replaceChildren(...charts.map((made) => made.figure));
  byId("charts").dataset.count = charts.length;
  for (const made of charts) observer.observe(made.plot); // which draws it, once it has a size
}

function chart(kind, motion) {
  const series = motion.wheels
    .map((wheel, i) => ({
      name: wheel.name,
      values: kind.of(wheel),
      colour: i,
      limit: limitOf(kind, wheel.name),
    }))
    .filter((one) => one.values);
  if (!series.length) return null;
  const figures = series.map((one) => {
    const value = element("b", {});
    const item = element(
      "li",
      { dataset: { colour: one.colour % 8 } },
      element("span", {}, words(one.name)),
      value,
    );
    one.show = value;
    return item;
  });
  const canvas = element("canvas", {});
  const cursor = element("i", { className: "cursor" });
  const plot = element("div", { className: "plot" }, canvas, cursor);
  plot.addEventListener("pointerdown", scrub);
  const top = series.reduce((most, one) => Math.max(most, peak(one.values)), 0);
  const limits = [...new Set(series.map((one) => one.limit))].filter(Number.isFinite);
  const said = limits.length ? `, limit ${limits.map(short).join(", ")}` : "";
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", `${kind.title}: largest ${short(top)} ${kind.unit}${said}`);
  const head = element("figcaption", {}, element("h3", {}, kind.title, element("small", {}, kind.unit)));
  const figure = element(
    "figure",
    { className: "chart" },
    head,
    plot,
    element("ul", { className: "legend" }, ...figures),
  );
  return { figure, plot, canvas, cursor, series, span: reach(series, limits, top), limits, motion };
}

function limitOf(kind, name) {
  const given = state.motion.request.robot.limits[kind.limit];
  return typeof given === "object" && given !== null ? given[name] : given;
}

function peak(values) {
  let most = 0;
  for (const value of values) most = Math.max(most, Math.abs(value));
  return most;
}

/** [low, high] of the vertical axis: the data, and the limits unless they are far off. */
function reach(series, limits, top) {
  let low = 0,
    high = 0;
  for (const { values } of series) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  const near = Math.max(0, ...limits.filter((limit) => limit < 4 * top));
  if (near && high > 0.02 * near) high = Math.max(high, near);
  if (near && low < -0.02 * near) low = Math.min(low, -near);
  const room = 0.06 * (high - low || 1);
  return [low < 0 ? low - room : low, high + room];
}

function draw(chart) {
  const { canvas, plot, series, span, motion } = chart;
  const ratio = Math.min(2, devicePixelRatio || 1);
  const { width, height } = plot.getBoundingClientRect();
  if (!width || !height) return;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const box = { left: PAD.left, right: width - PAD.right, top: PAD.top, bottom: height - PAD.bottom };
  const x = (time) => box.left + ((box.right - box.left) * time) / (motion.duration || 1);
  const y = (value) => box.bottom - ((box.bottom - box.top) * (value - span[0])) / (span[1] - span[0]);
  axes(context, box, x, y, span, motion.duration);
  context.save();
  context.beginPath();
  context.rect(box.left, box.top - 2, box.right - box.left, box.bottom - box.top + 4);
  context.clip();
  limitLines(context, box, y, chart.limits, span);
  for (const one of series) line(context, one, motion.time, x, y, box);
  context.restore();
  chart.x = x;
  follow();
}

function axes(context, box, x, y, span, duration) {
  context.font = "11px Inter, system-ui, sans-serif";
  context.fillStyle = palette.css.soft;
  context.lineWidth = 1;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const value of ticks(span[0], span[1], 4)) {
    const at = Math.round(y(value)) + 0.5;
    context.strokeStyle = palette.css[value === 0 ? "edge" : "line"];
    context.beginPath();
    context.moveTo(box.left, at);
    context.lineTo(box.right, at);
    context.stroke();
    context.fillText(short(value), box.left - 7, at);
  }
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  for (const time of ticks(0, duration, 5)) context.fillText(short(time), x(time), box.bottom + 15);
}

/** Round values between two, about `count` of them. */
function ticks(low, high, count) {
  const rough = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].map((k) => k * power).find((s) => s >= rough);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

function limitLines(context, box, y, limits, span) {
  context.strokeStyle = palette.css.bad;
  context.lineWidth = 1.2;
  context.setLineDash([5, 4]);
  for (const value of limits.flatMap((limit) => [limit, -limit])) {
    if (value < span[0] || value > span[1]) continue;
    context.beginPath();
    context.moveTo(box.left, y(value));
    context.lineTo(box.right, y(value));
    context.stroke();
  }
  context.setLineDash([]);
}

/** A series; where many samples fall on one column of pixels, their least and greatest are enough. */
function line(context, { values, colour }, time, x, y, box) {
  context.strokeStyle = seriesColour(colour);
  context.lineWidth = 1.5;
  context.lineJoin = "round";
  context.beginPath();
  const n = values.length;
  const perColumn = Math.max(1, Math.floor(n / (box.right - box.left)));
  for (let i = 0; i < n; i += perColumn) {
    let least = values[i],
      most = values[i];
    const end = Math.min(n, i + perColumn);
    for (let k = i + 1; k < end; k++) {
      if (values[k] < least) least = values[k];
      if (values[k] > most) most = values[k];
    }
    context.lineTo(x(time[i]), y(values[i]));
    if (end - i > 1) {
      context.lineTo(x(time[i]), y(least));
      context.lineTo(x(time[i]), y(most));
      context.lineTo(x(time[end - 1]), y(values[end - 1]));
    }
  }
  context.stroke();
}

/** The cursors and figures at the player's time. */
function follow() {
  const { motion } = state;
  if (!motion) return;
  const place = motion.locate(player.time);
  for (const { cursor, x, series } of charts) {
    if (x) cursor.style.transform = `translateX(${x(player.time)}px)`;
    for (const one of series) {
      const text = fixed(at(one.values, place), 2);
      if (one.text !== text) one.show.firstChild ? (one.show.firstChild.data = text) : one.show.append(text);
      one.text = text;
    }
  }
}

/** A chart is a scrubber too. */
function scrub(event) {
  const plot = event.currentTarget;
  const { duration } = state.motion;
  const go = (e) => {
    const { left, width } = plot.getBoundingClientRect();
    const share = (e.clientX - left - PAD.left) / (width - PAD.left - PAD.right);
    seek(share * duration);
  };
  pause();
  go(event);
  plot.setPointerCapture(event.pointerId);
  plot.addEventListener("pointermove", go);
  plot.addEventListener("lostpointercapture", () => plot.removeEventListener("pointermove", go), {
    once: true,
  });
}
