/** Elements in one expression. Text goes in as text, never as markup. */

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  const { dataset, role, ...rest } = properties;
  Object.assign(made, rest);
  Object.assign(made.dataset, dataset ?? {});
  if (role) made.setAttribute("role", role);
  made.append(...children.filter((child) => child !== ""));
  return made;
}

export function byId(id) {
  return document.getElementById(id);
}

const PATHS = {
  play: "M8 5.5v13l10.5-6.5z",
  pause: "M8 5.5v13M16 5.5v13",
  select: "M6 4l12 8.5-5.5 1 3 5.5-2.5 1.3-3-5.5-4 3.7z",
  box: "M5 7h14v10H5z",
  polygon: "M12 4.5l8 6-3 9H7l-3-9z",
  circle: "M12 4.5a7.5 7.5 0 1 0 .01 0z",
  fit: "M4 9V4h5M15 4h5v5M20 15v5h-5M9 20H4v-5",
  in: "M12 5v14M5 12h14",
  out: "M5 12h14",
  light:
    "M12 8a4 4 0 1 0 .01 0zM12 2v2.5M12 19.5V22M2 12h2.5M19.5 12H22M5 5l1.7 1.7M17.3 17.3L19 19M5 19l1.7-1.7M17.3 6.7L19 5",
  dark: "M19.5 14.5A8 8 0 0 1 9.5 4.5a8 8 0 1 0 10 10z",
  system: "M4 5h16v11H4zM9 20h6M12 16v4",
  close: "M6 6l12 12M18 6L6 18",
};

/** A line drawing, 24 × 24. */
export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  path.setAttribute("d", PATHS[name]);
  svg.append(path);
  if (name === "play") svg.classList.add("filled");
  return svg;
}
