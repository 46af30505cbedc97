/**
 * Where the wheels of each drive stand, in the body frame, for the picture: what the contract's table of drives
 * says. A drive that is not here is drawn as its footprint alone.
 *
 * @typedef {object} Wheel
 * @property {string} name
 * @property {number} x        m ahead of the body origin
 * @property {number} y        m to its left
 * @property {number} heading  rolling direction, rad; steering adds to it
 * @property {number} radius   m
 * @property {number} [trail]  m by which the contact trails its steering axis
 * @property {number} [roller] rad from the heading to a roller's axis, as seen from above
 * @property {boolean} [track] whether it is the sprocket of a track
 */

const axle = (x, d) => [
  [x, d.track_width / 2],
  [x, -d.track_width / 2],
];
const four = (d) => [...axle(d.wheelbase / 2, d), ...axle(-d.wheelbase / 2, d)];
const FOUR = ["front_left", "front_right", "rear_left", "rear_right"];

/** Wheels at points, named, of one radius. */
const at = (names, points, d, more = () => ({})) =>
  points.map(([x, y], i) => ({ name: names[i], x, y, heading: 0, radius: d.wheel_radius, ...more(i) }));

/** As many as the service takes at most: more may be half typed. */
const count = (d) => Math.min(d.wheel_count ?? 3, 32);

const numbered = (n) => Array.from({ length: n }, (_, i) => `wheel_${i + 1}`);

/** Points evenly round a circle. */
const ring = (n, radius, from = 0) =>
  Array.from({ length: n }, (_, i) => {
    const angle = from + (2 * Math.PI * i) / n;
    return [radius * Math.cos(angle), radius * Math.sin(angle), angle];
  });

const LAYOUTS = {
  differential: (d) => at(["left", "right"], axle(0, d), d),
  tracked: (d) => at(["left", "right"], axle(0, d), d, () => ({ track: true })),
  skid_steer: (d) => at(FOUR, four(d), d),
  mecanum: (d) => at(FOUR, four(d), d, (i) => ({ roller: i === 0 || i === 3 ? Math.PI / 4 : -Math.PI / 4 })),
  omni: (d) => {
    const places = ring(count(d), d.robot_radius, d.wheel_offset ?? 0);
    return at(numbered(places.length), places, d, (i) => ({
      heading: places[i][2] - Math.PI / 2,
      roller: 0,
    }));
  },
  // The contact's free direction is that of a roller at the floor; from above one sees its mirror image.
  swedish: (d) => d.wheels.map((w) => ({ ...w, roller: -w.roller_angle })),
  tricycle: (d) => at(["front", "rear_left", "rear_right"], [[d.wheelbase, 0], ...axle(0, d)], d),
  ackermann: (d) => at(FOUR, [...axle(d.wheelbase, d), ...axle(0, d)], d),
  // The contract does not say where they stand, since it does not matter to the motion.
  synchro: (d) => at(numbered(count(d)), ring(count(d), 2.2 * d.wheel_radius), d),
  swerve: (d) =>
    at(
      d.modules.map((m) => m.name),
      d.modules.map((m) => [m.x, m.y]),
      d,
    ),
  powered_caster: (d) =>
    at(
      d.modules.map((m) => m.name),
      d.modules.map((m) => [m.x, m.y]),
      d,
      () => ({ trail: d.caster_offset }),
    ),
};

/** The wheels of a drive, as far as its parameters are complete. @returns {Wheel[]} */
export function wheelsOf(drive) {
  try {
    const wheels = LAYOUTS[drive.type]?.(drive) ?? [];
    return wheels.filter((w) => [w.x, w.y, w.heading, w.radius].every(Number.isFinite) && w.radius > 0);
  } catch {
    return []; // half typed: the form says what is missing
  }
}
