/** A plan as typed arrays, and where everything is at any time. */

import { outline, reach } from "./geometry.js";
import { wheelsOf } from "./wheels.js";

/**
 * @typedef {object} Series  of one wheel
 * @property {string} name
 * @property {Float64Array} angle, velocity, acceleration
 * @property {?{angle: Float64Array, rate: Float64Array}} steering
 */

export class Motion {
  /** @param answer the answer of POST /v1/plans  @param request what was asked */
  constructor(answer, request) {
    this.answer = answer;
    this.request = request;
    this.duration = answer.duration;
    this.time = Float64Array.from(answer.schedule.time);
    this.pose = columns(answer.trajectory, ["x", "y", "theta", "vx", "vy", "omega"]);
    /** @type {Series[]} */
    this.wheels = Object.entries(answer.schedule.wheels).map(([name, wheel]) => ({
      name,
      ...columns(wheel, ["angle", "velocity", "acceleration"]),
      steering: answer.schedule.steering[name]
        ? columns(answer.schedule.steering[name], ["angle", "rate"])
        : null,
    }));
    this.outline = outline(request.robot.footprint);
    this.layout = wheelsOf(request.robot.drive);
    // A synchro drive turns its wheels and leaves its body as it stands.
    const { drive } = request.robot;
    this.bodyHeading = drive.type === "synchro" ? (drive.body_heading ?? request.start.theta) : null;
    this.way = travelled(this.pose, this.bodyHeading === null ? reach(this.outline) : 0);
    this.byName = new Map(this.wheels.map((wheel) => [wheel.name, wheel]));
  }

  get samples() {
    return this.time.length;
  }

  /** The sample at or before a time, and the share of the way to the next. */
  locate(time) {
    let low = 0,
      high = this.time.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.time[middle] <= time) low = middle;
      else high = middle;
    }
    const step = this.time[high] - this.time[low];
    const share = step > 0 ? Math.min(1, Math.max(0, (time - this.time[low]) / step)) : 0;
    return { low, high, share };
  }

  /** The body's pose at a place in time, for the picture. */
  poseAt(place) {
    const { x, y, theta } = this.pose;
    return { x: at(x, place), y: at(y, place), theta: this.bodyHeading ?? at(theta, place) };
  }

  /** The pose of sample i, for the picture. */
  sample(i) {
    return { x: this.pose.x[i], y: this.pose.y[i], theta: this.bodyHeading ?? this.pose.theta[i] };
  }

  /** Angle that a wheel has turned, and its steering angle. */
  wheelAt(name, place) {
    const wheel = this.byName.get(name);
    if (!wheel) return { turned: 0, steered: 0 };
    return { turned: at(wheel.angle, place), steered: wheel.steering ? at(wheel.steering.angle, place) : 0 };
  }
}

/** A series at a place in time. */
export function at(series, { low, high, share }) {
  return series[low] + share * (series[high] - series[low]);
}

/** How far the rim of a footprint has come at each sample, m: the body origin's way and the turning at `rim`. */
function travelled({ x, y, theta }, rim) {
  const way = new Float64Array(x.length);
  for (let i = 1; i < way.length; i++) {
    way[i] =
      way[i - 1] + Math.hypot(x[i] - x[i - 1], y[i] - y[i - 1]) + rim * Math.abs(theta[i] - theta[i - 1]);
  }
  return way;
}

function columns(of, names) {
  return Object.fromEntries(names.map((name) => [name, Float64Array.from(of[name])]));
}
