/** The request under edit, what became of the last one, and who wants to know when either changes. */

export const state = {
  /** Body of POST /v1/plans, as it will be sent. */
  request: null,
  /** What GET /v1/drives and /openapi.json say, by name. */
  drives: new Map(),
  schemas: {},
  /** Summaries of the server's maps. */
  maps: [],
  /** The plan in view (motion.js), or null; whether the request has changed since it was asked for. */
  motion: null,
  stale: false,
  /** The problem document in view, or null. */
  problem: null,
  /** Index of the selected obstacle, or null. */
  selected: null,
  /** The drawing tool in hand: "select", "box", "polygon" or "circle". */
  tool: "select",
};

const listeners = new Map();
/** Earlier requests as JSON; changes without a PAUSE (ms) between them are one. */
const past = [];
const PAUSE = 400;
let touched = -Infinity;

/** Calls listener(detail) whenever somebody tells the topic: request, motion, problem, view, time. */
export function on(topic, listener) {
  listeners.set(topic, [...(listeners.get(topic) ?? []), listener]);
}

export function tell(topic, detail) {
  for (const listener of listeners.get(topic) ?? []) listener(detail);
}

/**
 * Changes the request. `rebuild` names what the change makes new in the form, beyond values: a section's
 * name, "all", or nothing; "pose" where only start or goal has moved.
 */
export function edit(change, rebuild = "") {
  remember();
  change(state.request);
  changed(rebuild);
}

/** Takes back the last change, or a drag as a whole. */
export function undo() {
  if (!past.length) return;
  state.request = JSON.parse(past.pop());
  state.selected = null;
  changed("all");
}

function remember() {
  const now = performance.now();
  if (now - touched > PAUSE) past.push(JSON.stringify(state.request));
  if (past.length > 50) past.shift();
  touched = now;
}

function changed(rebuild) {
  const shown = state.problem !== null || state.stale !== (state.motion !== null);
  state.stale = state.motion !== null;
  state.problem = null;
  if (shown) tell("problem");
  tell("request", rebuild);
}

export function select(index) {
  state.selected = index;
  tell("request", "obstacles");
}

/** The parts of a JSON pointer (RFC 6901). */
export function parts(pointer) {
  return pointer
    .split("/")
    .slice(1)
    .map((part) => part.replaceAll("~1", "/").replaceAll("~0", "~"));
}

export function join(pointer, part) {
  return `${pointer}/${String(part).replaceAll("~", "~0").replaceAll("/", "~1")}`;
}

export function getAt(document, pointer) {
  return parts(pointer).reduce((value, part) => value?.[part], document);
}

/** Sets the value at a pointer; undefined removes it. Objects on the way are made. */
export function setAt(document, pointer, value) {
  const way = parts(pointer);
  const last = way.pop();
  const holder = way.reduce((at, part) => (at[part] ??= {}), document);
  if (value === undefined) delete holder[last];
  else holder[last] = value;
}
