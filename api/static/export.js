/** Taking it elsewhere: the request as a curl command or a link, the plan as a file. */

import { byId, element } from "./dom.js";
import { link } from "./link.js";
import { complain } from "./problems.js";
import { on, state, tell } from "./state.js";

/** Every format on offer. `make` gets the motion in view and returns, or promises, what goes into the file. */
const DOWNLOADS = [
  { title: "JSON", extension: "json", type: "application/json", make: ({ answer }) => JSON.stringify(answer) },
  { title: "CSV", extension: "csv", type: "text/csv", make: ({ answer }) => csv(answer) },
];

export function startExport() {
  const buttons = DOWNLOADS.map((format) => {
    const button = element("button", { type: "button" }, format.title);
    button.addEventListener("click", () => download(format));
    return button;
  });
  byId("downloads").append(...buttons);
  byId("copy-curl").addEventListener("click", (event) => copy(byId("curl").textContent, event.target));
  byId("copy-link").addEventListener("click", async (event) => copy(await link(state.motion.request), event.target));
  on("motion", () => {
    if (state.motion) byId("curl").textContent = curl(state.motion.request);
  });
}

/** The command that asks for the plan in view. */
function curl(request) {
  const body = JSON.stringify(request).replaceAll("'", "'\\''");
  return `curl -s ${location.origin}/v1/plans \\\n  -H 'Content-Type: application/json' \\\n  -d '${body}'`;
}

async function download({ extension, type, make }) {
  try {
    const url = URL.createObjectURL(new Blob([await make(state.motion)], { type }));
    element("a", { href: url, download: `plan-${state.motion.answer.id.slice(0, 8)}.${extension}` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 1e3);
  } catch (error) {
    complain(error.problem);
  }
}

/** The table that `Accept: text/csv` gives. */
function csv({ schedule, trajectory }) {
  const columns = [
    ["time", schedule.time],
    ...["x", "y", "theta"].map((name) => [name, trajectory[name]]),
    ...Object.entries(schedule.wheels).map(([name, wheel]) => [`${name}.velocity`, wheel.velocity]),
    ...Object.entries(schedule.steering).map(([name, wheel]) => [`${name}.steering`, wheel.angle]),
  ];
  const rows = schedule.time.map((_, i) => columns.map(([, values]) => values[i]).join(","));
  return [columns.map(([name]) => name).join(","), ...rows, ""].join("\n");
}

/** Where the page is not served over TLS or from this machine, there is no clipboard interface but this old one. */
async function copy(text, button) {
  if (navigator.clipboard) await navigator.clipboard.writeText(text).catch(() => {});
  else {
    const area = element("textarea", { value: text, className: "unseen" });
    button.after(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  const title = button.textContent;
  button.textContent = "Copied";
  setTimeout(() => (button.textContent = title), 1200);
  tell("announce", "Copied.");
}
