/** What the page opens with: a small warehouse, so that pressing "Plan" shows something at once. */

const box = (x0, y0, x1, y1) => ({ type: "polygon", vertices: [[x0, y0], [x1, y0], [x1, y1], [x0, y1]] });

export const EXAMPLE = {
  robot: {
    drive: { type: "ackermann", wheel_radius: 0.15, wheelbase: 0.8, track_width: 0.5 },
    footprint: { type: "rectangle", length: 1.2, width: 0.65, offset: 0.4 },
    limits: { wheel_speed: 12, wheel_acceleration: 14, steering_angle: 0.7, steering_rate: 1.5 },
  },
  start: { x: 1, y: 0.85, theta: 0 },
  goal: { x: 12.1, y: 3.1, theta: 3.1416 },
  environment: {
    bounds: { x_min: 0, y_min: 0, x_max: 13, y_max: 6 },
    obstacles: [
      // racks in two rows, with an aisle across
      box(2.2, 1.7, 5.4, 2.6), box(7, 1.7, 9.5, 2.6),
      box(2.2, 3.9, 5.4, 4.8), box(7, 3.9, 9.5, 4.8),
      // the two walls of a dock, pillars, and pallets set down by hand
      box(11.2, 2.3, 13, 2.45), box(11.2, 3.75, 13, 3.9),
      { type: "circle", center: [6.1, 5.2], radius: 0.2 },
      { type: "circle", center: [10.6, 0.9], radius: 0.2 },
      { type: "polygon", vertices: [[3.5, 5.1], [4.45, 5.25], [4.36, 5.85], [3.41, 5.7]] },
      { type: "polygon", vertices: [[7.9, 0.2], [8.8, 0.3], [8.73, 0.9], [7.83, 0.8]] },
      { type: "polygon", vertices: [[0.5, 3], [1.1, 2.95], [1.2, 3.85], [0.6, 3.9]] },
    ],
  },
  options: { time_budget: 5, effort: "good", seed: 1 },
};
