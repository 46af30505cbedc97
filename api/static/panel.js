/** The setup form: a section for each part of the request. */

import { uploadMap } from "./client.js";
import { byId, element } from "./dom.js";
import { bind, fields, line, points, refresh } from "./form.js";
import { label, short, words } from "./format.js";
import { outline, reach } from "./geometry.js";
import { chooseMap, shortId } from "./maps.js";
import { complain } from "./problems.js";
import { edit, on, select, setAt, state, tell } from "./state.js";
import { wheelsOf } from "./wheels.js";

const SECTIONS = [
  { name: "drive", title: "Drive", open: true, make: drive, gist: (r) => words(r.robot.drive.type) },
  { name: "footprint", title: "Footprint", make: footprint, gist: footprintGist },
  { name: "limits", title: "Limits", make: limits, gist: limitsGist },
  { name: "start", title: "Start", make: start, gist: (r) => poseGist(r.start) },
  { name: "goal", title: "Goal", make: goal, gist: (r) => poseGist(r.goal) },
  { name: "space", title: "Map and bounds", make: space, gist: spaceGist },
  { name: "obstacles", title: "Obstacles", make: obstacles, gist: (r) => String(obstaclesOf(r).length) },
  { name: "options", title: "Options", make: options, gist: (r) => r.options.effort ?? "good" },
];
// What changes with another drive: the names of its wheels stand in all of these.
const FOLLOWING = { drive: ["drive", "limits", "start"], names: ["limits", "start"] };

export function startPanel() {
  const form = byId("setup");
  form.addEventListener("submit", (event) => event.preventDefault());
  for (const section of SECTIONS) {
    section.gistAt = element("span", { className: "gist" });
    section.body = element("div", { className: "fields" });
    const summary = element("summary", {}, element("span", {}, section.title), section.gistAt);
    const open = section.open ?? false;
    form.append(element("details", { open, dataset: { section: section.name } }, summary, section.body));
  }
  on("request", (rebuild) => {
    for (const section of SECTIONS) {
      const named = FOLLOWING[rebuild] ?? [rebuild];
      if (rebuild === "all" || named.includes(section.name)) section.body.replaceChildren(...section.make());
      section.gistAt.textContent = section.gist(state.request);
    }
    refresh();
  });
}

/** Opens the section in which an element stands. */
export function reveal(inner) {
  const section = inner.closest("details");
  if (section) section.open = true;
}

const schema = (name) => state.schemas[name];
const wheelNames = () => wheelsOf(state.request.robot.drive).map((wheel) => wheel.name);

/** Names of the steered wheels: all wheels, or as many of the first as the drive's example has. */
function steeredNames() {
  const { wheels, steering } = state.drives.get(state.request.robot.drive.type);
  return steering.length === wheels.length ? wheelNames() : steering;
}

function drive() {
  const { drive } = state.request.robot;
  const kinds = [...state.drives.keys()].map((kind) => element("option", { value: kind }, label(kind)));
  const input = element("select", {}, ...kinds);
  bind(input, "/robot/drive/type", (value) => (input.value = value));
  input.addEventListener("change", () => edit((request) => takeDrive(request, input.value), "all"));
  const { parameters } = state.drives.get(drive.type);
  return [
    line({ name: "type", title: "Type", pointer: "/robot/drive/type" }, input, ""),
    ...fields(parameters, parameters.$defs ?? {}, "/robot/drive"),
  ];
}

/** Another drive, as its example has it, with a footprint around its wheels and limits that it needs. */
export function takeDrive(request, kind) {
  const { example, wheels, steering } = state.drives.get(kind);
  request.robot.drive = structuredClone(example);
  const spots = wheelsOf(example);
  const span = (axis) => Math.max(0.15, ...spots.map((w) => Math.abs(w[axis]) + w.radius));
  const [front, back] = [
    Math.max(0.3, ...spots.map((w) => w.x + w.radius)),
    Math.min(-0.3, ...spots.map((w) => w.x - w.radius)),
  ];
  const size = (value) => Number(value.toFixed(2));
  request.robot.footprint =
    kind === "omni" || kind === "synchro"
      ? { type: "circle", radius: size(reach(spots.map((w) => [w.x, w.y])) + 0.1) }
      : {
          type: "rectangle",
          length: size(front - back + 0.1),
          width: size(2 * span("y")),
          offset: size((front + back) / 2),
        };
  const { wheel_speed, wheel_acceleration } = request.robot.limits;
  const plain = (value, otherwise) => (typeof value === "number" ? value : otherwise);
  request.robot.limits = {
    wheel_speed: plain(wheel_speed, 15),
    wheel_acceleration: plain(wheel_acceleration, 20),
  };
  // Where only some wheels steer the drive is car-like, and must be told how far; the others turn all round.
  if (steering.length) request.robot.limits.steering_rate = steering.length < wheels.length ? 2 : 6;
  if (steering.length && steering.length < wheels.length) request.robot.limits.steering_angle = 0.8;
  delete request.start.steering;
}

function footprint() {
  const kinds = { rectangle: "RectangleFootprint", polygon: "PolygonFootprint", circle: "CircleFootprint" };
  const pointer = "/robot/footprint";
  const input = element(
    "select",
    {},
    ...Object.keys(kinds).map((kind) => element("option", { value: kind }, label(kind))),
  );
  bind(input, `${pointer}/type`, (value) => (input.value = value));
  input.addEventListener("change", () =>
    edit(({ robot }) => (robot.footprint = reshaped(robot.footprint, input.value)), "footprint"),
  );
  const kind = kinds[state.request.robot.footprint.type];
  return [
    line({ name: "type", title: "Shape", pointer: `${pointer}/type` }, input, ""),
    ...fields(schema(kind), state.schemas, pointer),
  ];
}

/** A footprint as another kind of about the same size. */
function reshaped(from, kind) {
  const shape = outline(from);
  const radius = Number(reach(shape).toFixed(3)) || 0.3;
  if (kind === "circle") return { type: kind, radius };
  if (kind === "rectangle") return { type: kind, length: 2 * radius, width: 2 * radius };
  const vertices =
    from.type === "circle" ? outline({ type: "rectangle", length: 2 * radius, width: 2 * radius }) : shape;
  return { type: kind, vertices: vertices.map((v) => v.map((c) => Number(c.toFixed(3)))) };
}

function limits() {
  const skip = steeredNames().length ? [] : ["steering_angle", "steering_rate"];
  return fields(schema("LimitsSchema"), state.schemas, "/robot/limits", { skip, wheels: wheelNames() });
}

function start() {
  const steered = steeredNames();
  const given = state.request.start.steering !== undefined;
  const shown = fields(schema("StartSchema"), state.schemas, "/start", {
    skip: steered.length && given ? [] : ["steering"],
    wheels: steered,
  });
  if (!steered.length) return shown;
  const change = (request) => {
    request.start.steering = given ? undefined : Object.fromEntries(steered.map((name) => [name, 0]));
  };
  return [...shown, ticked("Steering stands as given", given, change, "start")];
}

function goal() {
  const any = state.request.goal.theta === null;
  const change = (request) => (request.goal.theta = any ? request.start.theta : null);
  const shown = fields(schema("GoalSchema"), state.schemas, "/goal", { skip: any ? ["theta"] : [] });
  return [...shown, ticked("Any heading", any, change, "goal")];
}

/** A box to tick that changes what its section shows. */
function ticked(title, checked, change, section) {
  const input = element("input", { type: "checkbox", className: "check", checked });
  input.addEventListener("change", () => edit(change, section));
  return line({ title, pointer: `#${title}` }, input, "");
}

function space() {
  const { environment } = state.request;
  const chosen = environment.map?.id ?? "";
  const none = element("option", { value: "" }, "None");
  const known = state.maps.map((map) => {
    const size = [map.width, map.height].map((cells) => short(cells * map.resolution)).join(" × ");
    return element("option", { value: map.id }, `${size} m, ${shortId(map.id)}`);
  });
  const input = element("select", {}, none, ...known);
  input.value = chosen;
  input.addEventListener("change", () => chooseMap(input.value));
  const file = element("input", {
    type: "file",
    multiple: true,
    accept: ".yaml,.yml,.pgm,.png",
    className: "unseen",
  });
  file.addEventListener("change", () => upload([...file.files]).finally(() => (file.value = "")));
  const button = element("label", { className: "quiet upload" }, "Upload a yaml and its image", file);
  const made = [line({ title: "Map", pointer: "/environment/map" }, input, ""), button];
  if (chosen)
    made.push(...fields(schema("MapReference"), state.schemas, "/environment/map", { skip: ["id"] }));
  const bounded = environment.bounds !== undefined;
  if (chosen) {
    const change = ({ environment: e }) => (e.bounds = bounded ? undefined : mapBox(chosen));
    made.push(ticked("Bounds too", bounded, change, "space"));
  }
  if (bounded) made.push(...fields(schema("BoundsSchema"), state.schemas, "/environment/bounds"));
  return made;
}

function mapBox(id) {
  const { origin, width, height, resolution } = state.maps.find((map) => map.id === id);
  const round = (value) => Number(value.toFixed(3));
  const [x, y] = origin;
  return {
    x_min: round(x),
    y_min: round(y),
    x_max: round(x + width * resolution),
    y_max: round(y + height * resolution),
  };
}

async function upload(files) {
  const yaml = files.find((file) => /\.ya?ml$/i.test(file.name));
  const image = files.find((file) => /\.(pgm|png)$/i.test(file.name));
  if (!yaml || !image) {
    complain({
      code: "",
      title: "A map is two files",
      detail: "Choose its yaml and its PGM or PNG image together.",
    });
    return;
  }
  try {
    const map = await uploadMap(yaml, image);
    state.maps = [...state.maps.filter((known) => known.id !== map.id), map];
    chooseMap(map.id);
  } catch (error) {
    complain(error.problem);
  }
}

function obstacles() {
  const list = obstaclesOf(state.request);
  const buttons = list.map((obstacle, i) => {
    const title = `${label(obstacle.type)} ${i + 1}`;
    const item = element(
      "button",
      { type: "button", className: "obstacle", dataset: { pointer: `/environment/obstacles/${i}` } },
      title,
    );
    item.setAttribute("aria-pressed", String(i === state.selected));
    item.addEventListener("click", () => {
      select(i === state.selected ? null : i);
      byId("setup").querySelectorAll(".obstacle")[i]?.focus();
    });
    return item;
  });
  const chips = element(
    "div",
    { className: "chips", dataset: { pointer: "/environment/obstacles" } },
    ...buttons,
  );
  const at = state.selected;
  if (at === null || !list[at])
    return [
      chips,
      element(
        "p",
        { className: "hint" },
        "Draw on the floor plan with the tools there; select one to change it.",
      ),
    ];
  const pointer = `/environment/obstacles/${at}`;
  const remove = element("button", { type: "button", className: "quiet" }, "Delete");
  remove.addEventListener("click", () => removeObstacle(at));
  const inner =
    list[at].type === "circle"
      ? [
          centre(pointer, 0),
          centre(pointer, 1),
          ...fields(schema("CircleObstacle"), state.schemas, pointer, { skip: ["center"] }),
        ]
      : [
          points({
            name: "vertices",
            pointer: `${pointer}/vertices`,
            about: schema("PolygonObstacle").properties.vertices,
          }),
        ];
  return [chips, ...inner, remove];
}

function centre(obstacle, axis) {
  const pointer = `${obstacle}/center/${axis}`;
  const input = element("input", { type: "number", step: "any", inputMode: "decimal" });
  bind(input, pointer, (value) => (input.value = value));
  input.addEventListener("input", () =>
    edit((request) => setAt(request, pointer, input.value === "" ? null : input.valueAsNumber)),
  );
  return line(
    { title: axis ? "Centre y" : "Centre x", pointer },
    input,
    "",
    element("span", { className: "unit" }, "m"),
  );
}

export function removeObstacle(index) {
  state.selected = null;
  edit(({ environment }) => environment.obstacles.splice(index, 1), "obstacles");
  tell("announce", "Obstacle deleted.");
}

function options() {
  return fields(schema("OptionsSchema"), state.schemas, "/options");
}

const obstaclesOf = (request) => request.environment.obstacles ?? [];
const poseGist = (pose) => `${short(pose.x)}, ${short(pose.y)}`;

function footprintGist({ robot: { footprint: f } }) {
  if (f.type === "rectangle") return `${short(f.length)} × ${short(f.width)} m`;
  return f.type === "circle" ? `⌀ ${short(2 * f.radius)} m` : `${f.vertices?.length ?? 0} corners`;
}

function limitsGist({ robot: { limits: l } }) {
  return typeof l.wheel_speed === "number" ? `${short(l.wheel_speed)} rad/s` : "by wheel";
}

function spaceGist({ environment: { map, bounds } }) {
  if (map) return shortId(map.id);
  return bounds ? `${short(bounds.x_max - bounds.x_min)} × ${short(bounds.y_max - bounds.y_min)} m` : "";
}
