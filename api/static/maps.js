/** The server's maps: choosing one, and its picture in the theme's colours. */

import { getBlob } from "./client.js";
import { placed } from "./geometry.js";
import { palette } from "./palette.js";
import { edit, state, tell } from "./state.js";

/** What a map took the place of, so that "None" brings it back. */
let before = null;
/** Pictures by map id: the grey levels as they came, and what was painted of them. */
const pictures = new Map();

export const shortId = (id) => id.slice(0, 8);

export const summary = () => state.maps.find((map) => map.id === state.request.environment.map?.id);

/** Plans on a map instead of the drawn obstacles; "" goes back to them. */
export function chooseMap(id) {
  const { environment, start, goal } = state.request;
  if (!environment.map) before = structuredClone({ environment, start, goal });
  state.selected = null;
  edit((request) => {
    if (!id) {
      Object.assign(
        request,
        structuredClone(
          before ?? { environment: { bounds: { x_min: 0, y_min: 0, x_max: 10, y_max: 6 }, obstacles: [] } },
        ),
      );
      return;
    }
    request.environment = { map: { id, unknown: environment.map?.unknown ?? "occupied" } };
    const map = state.maps.find((known) => known.id === id);
    for (const [pose, share] of [
      [request.start, 0.3],
      [request.goal, 0.7],
    ]) {
      if (!on(map, pose)) [pose.x, pose.y] = spot(map, share).map((value) => Number(value.toFixed(2)));
    }
  }, "all");
  tell("fit");
}

function spot(map, share) {
  const [x, y, theta] = map.origin;
  return placed([[share * map.width * map.resolution, 0.5 * map.height * map.resolution]], {
    x,
    y,
    theta,
  })[0];
}

/** Where a world point lies on a map, in cells from its lower left corner. */
export function cell(map, [px, py]) {
  const [x, y, theta] = map.origin;
  const c = Math.cos(theta),
    s = Math.sin(theta);
  return [(c * (px - x) + s * (py - y)) / map.resolution, (c * (py - y) - s * (px - x)) / map.resolution];
}

function on(map, pose) {
  const [column, row] = cell(map, [pose.x, pose.y]);
  return column > 0 && row > 0 && column < map.width && row < map.height;
}

/** The corners of a map in the world. */
export function mapCorners(map) {
  const w = map.width * map.resolution,
    h = map.height * map.resolution;
  const [x, y, theta] = map.origin;
  return placed(
    [
      [0, 0],
      [w, 0],
      [w, h],
      [0, h],
    ],
    { x, y, theta },
  );
}

/** The map's picture in the theme's colours, or null while it is fetched: then "request" is told later. */
export function picture(map) {
  const known = pictures.get(map.id);
  if (!known) {
    pictures.set(map.id, { grey: null });
    load(map);
    return null;
  }
  if (!known.grey) return null;
  if (known.theme !== palette.css.wall) paint(known);
  return known.painted;
}

async function load(map) {
  try {
    const bitmap = await createImageBitmap(await getBlob(`/v1/maps/${map.id}/image`));
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(bitmap, 0, 0);
    pictures.set(map.id, { grey: context.getImageData(0, 0, bitmap.width, bitmap.height) });
    tell("request", "");
  } catch {
    pictures.delete(map.id); // drawn without: the plan does not need the picture
  }
}

/** Free cells are left open, so that the floor and its grid show. */
function paint(known) {
  const { width, height, data } = known.grey;
  const made = new ImageData(width, height);
  const colours = new Uint32Array(made.data.buffer);
  const packed = ([r, g, b]) => ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0;
  const wall = packed(palette.rgb.wall),
    unknown = packed(palette.rgb.unknown);
  for (let i = 0; i < colours.length; i++) {
    const kind = kindOf(data[4 * i]);
    if (kind) colours[i] = kind === "wall" ? wall : unknown;
  }
  known.painted ??= new OffscreenCanvas(width, height);
  known.painted.getContext("2d").putImageData(made, 0, 0);
  known.theme = palette.css.wall;
}

/** What a grey level of the service's picture means: black is occupied, white is free. */
function kindOf(grey) {
  return grey < 64 ? "wall" : grey < 224 ? "unknown" : "";
}

/** Centres of the cells that stand in the way of a footprint, a polygon in the world. */
export function hits(map, polygon, covers) {
  const grey = pictures.get(map.id)?.grey;
  if (!grey) return [];
  const cells = polygon.map((corner) => cell(map, corner));
  const range = (axis, end) => [
    Math.max(0, Math.floor(Math.min(...cells.map((c) => c[axis])))),
    Math.min(end - 1, Math.ceil(Math.max(...cells.map((c) => c[axis])))),
  ];
  const [left, right] = range(0, map.width),
    [low, high] = range(1, map.height);
  const strict = state.request.environment.map.unknown !== "free";
  const found = [];
  for (let row = low; row <= high; row++) {
    for (let column = left; column <= right; column++) {
      const kind = kindOf(grey.data[4 * ((map.height - 1 - row) * map.width + column)]);
      if ((kind === "wall" || (strict && kind)) && covers([column + 0.5, row + 0.5], cells))
        found.push([column, row]);
    }
  }
  return found;
}
