/** Form fields made from JSON schemas, each bound to the request by its JSON pointer. */

import { element } from "./dom.js";
import { label, unit } from "./format.js";
import { edit, getAt, join, setAt, state } from "./state.js";

let ids = 0;
const bound = new Map();

/** The value that a field shows is read anew, unless somebody is typing in it. */
export function refresh() {
  for (const [control, show] of bound) {
    if (!control.isConnected) bound.delete(control);
    else if (control !== document.activeElement) show();
  }
}

/** The fields of an object schema's properties at a pointer. `skip` names those that are shown elsewhere. */
export function fields(schema, definitions, pointer, { skip = [], wheels = [] } = {}) {
  const required = new Set(schema.required ?? []);
  return Object.entries(schema.properties)
    .filter(([name, about]) => !skip.includes(name) && !("const" in about))
    .map(([name, about]) => {
      const { shape, ...rest } = flat(about, definitions);
      const context = { name, pointer: join(pointer, name), about: rest, optional: !required.has(name) };
      return control(shape, context, definitions, wheels);
    });
}

function control(shape, context, definitions, wheels) {
  if (shape.enum) return choice(shape, context);
  if (shape.type === "boolean") return toggle(context);
  if (shape.oneOf) return perWheel(shape.oneOf[0], context, wheels);
  if (shape.patternProperties) return byWheel(Object.values(shape.patternProperties)[0], context, wheels);
  if (shape.type === "array" && shape.items.type === "array") return points(context);
  if (shape.type === "array") return items(shape, context, definitions);
  return entry(shape, context);
}

/** A schema without its references and its "or null". */
function flat(about, definitions) {
  const shape = about.anyOf?.find((option) => option.type !== "null") ?? about;
  const target = shape.$ref ? definitions[shape.$ref.split("/").at(-1)] : shape;
  return { ...about, shape: target };
}

/** A labelled line of the form. Its error, if any, is put after it by its pointer (problems.js). */
export function line(context, input, help, ...more) {
  input.id = `field-${++ids}`;
  const hint = element("span", { className: "help", id: `${input.id}-help`, role: "tooltip" }, help);
  input.setAttribute("aria-describedby", hint.id);
  return element(
    "div",
    { className: "field", dataset: { pointer: context.pointer } },
    element("label", { htmlFor: input.id }, context.title ?? label(context.name)),
    element("span", { className: "entry" }, input, ...more),
    help ? hint : "",
  );
}

/** A number or a name. Optional: an empty field is an absent one. */
function entry(shape, context) {
  const { pointer, about, optional } = context;
  const number = shape.type !== "string";
  const input = element(
    "input",
    number ? { type: "number", step: "any", inputMode: "decimal" } : { type: "text" },
  );
  if (optional) input.placeholder = about.default ?? "none";
  bind(input, pointer, (value) => {
    if (number) input.value = Number.isFinite(value) ? String(Number(value.toPrecision(5))) : "";
    else input.value = value ?? "";
  });
  input.addEventListener("input", () => {
    const value = input.value === "" ? undefined : number ? input.valueAsNumber : input.value;
    edit((request) => setAt(request, pointer, value), /\/name$/.test(pointer) ? "names" : "");
  });
  const suffix = about["x-unit"] ?? shape["x-unit"];
  return line(
    context,
    input,
    help(about, shape),
    element("span", { className: "unit" }, suffix ? unit(suffix) : ""),
  );
}

function choice(shape, context) {
  const input = element(
    "select",
    {},
    ...shape.enum.map((value) => element("option", { value }, label(value))),
  );
  bind(input, context.pointer, (value) => (input.value = value ?? context.about.default));
  input.addEventListener("change", () => edit((request) => setAt(request, context.pointer, input.value)));
  return line(context, input, help(context.about, shape));
}

function toggle(context) {
  const input = element("input", { type: "checkbox", className: "check" });
  bind(input, context.pointer, (value) => (input.checked = value ?? context.about.default));
  input.addEventListener("change", () => edit((request) => setAt(request, context.pointer, input.checked)));
  return line(context, input, help(context.about, {}));
}

/** A limit: one number for every wheel, or one for each. */
function perWheel(number, context, wheels) {
  const { pointer } = context;
  const holder = element("div", { className: "per-wheel" });
  const show = () => {
    const each = typeof getAt(state.request, pointer) === "object";
    const button = element(
      "button",
      { type: "button", className: "quiet each" },
      each ? "one for all" : "by wheel",
    );
    button.setAttribute("aria-label", `${label(context.name)}: ${button.textContent}`);
    button.addEventListener("click", () => {
      const value = getAt(state.request, pointer);
      const split = () => Object.fromEntries(wheels.map((name) => [name, value ?? number.maximum]));
      edit((request) => setAt(request, pointer, each ? Object.values(value)[0] : split()));
      show();
      holder.querySelector("input").focus();
    });
    const lines = each ? [byWheel(number, context, wheels)] : [entry(number, context)];
    holder.replaceChildren(...lines, button);
  };
  show();
  return holder;
}

/** One number for each wheel. */
function byWheel(number, context, wheels) {
  const lines = wheels.map((name) =>
    entry(number, { ...context, name, title: name, pointer: join(context.pointer, name) }),
  );
  return element(
    "fieldset",
    { dataset: { pointer: context.pointer } },
    element("legend", {}, label(context.name)),
    ...lines,
  );
}

/** Points, one a line: "x, y". */
export function points(context) {
  const { pointer } = context;
  const input = element("textarea", { rows: 4, spellcheck: false });
  bind(input, pointer, (value) => {
    input.value = (value ?? []).map((point) => point.join(", ")).join("\n");
    input.rows = Math.min(8, Math.max(3, (value ?? []).length));
  });
  input.addEventListener("input", () => edit((request) => setAt(request, pointer, parsePoints(input.value))));
  const field = line(context, input, `${context.about.description} One a line.`);
  field.classList.add("tall");
  return field;
}

/** Text as points. What is no number becomes null, so that the service names it. */
function parsePoints(text) {
  const number = (word) => (word !== "" && Number.isFinite(Number(word)) ? Number(word) : null);
  return text
    .split("\n")
    .filter((row) => row.trim())
    .map((row) =>
      row
        .trim()
        .split(/[,;\s]+/)
        .map(number),
    );
}

/** A list of objects: modules, or wheels. */
function items(shape, context, definitions) {
  const { pointer, name } = context;
  const schema = flat(shape.items, definitions).shape;
  const singular = label(name).replace(/s$/, "");
  const list = getAt(state.request, pointer) ?? [];
  const blocks = list.map((item, i) => {
    const remove = element("button", { type: "button", className: "quiet" }, "Remove");
    remove.setAttribute("aria-label", `Remove ${item.name}`);
    remove.addEventListener("click", () => edit((request) => getAt(request, pointer).splice(i, 1), "drive"));
    const legend = element("legend", {}, `${singular} ${i + 1}`, remove);
    const inner = fields(schema, definitions, join(pointer, i));
    return element(
      "fieldset",
      { className: "item", dataset: { pointer: join(pointer, i) } },
      legend,
      ...inner,
    );
  });
  const add = element("button", { type: "button", className: "quiet" }, `Add a ${singular.toLowerCase()}`);
  add.addEventListener("click", () => {
    const last = list.at(-1) ?? context.about.examples[0][0];
    const more = { ...last, name: `${singular.toLowerCase()}_${list.length + 1}`, y: -last.y };
    edit((request) => getAt(request, pointer).push(more), "drive");
  });
  return element("div", { dataset: { pointer } }, ...blocks, add);
}

/** Shows the request's value in a control now and at each refresh. */
export function bind(input, pointer, show) {
  const now = () => show(getAt(state.request, pointer));
  bound.set(input, now);
  now();
}

/** What the schema says of a field, in words. */
function help(about, shape) {
  const bounds = [
    shape.exclusiveMinimum !== undefined && `more than ${shape.exclusiveMinimum}`,
    shape.minimum !== undefined && `at least ${plain(shape.minimum)}`,
    shape.exclusiveMaximum !== undefined && `less than ${plain(shape.exclusiveMaximum)}`,
    shape.maximum !== undefined && `at most ${plain(shape.maximum)}`,
  ].filter(Boolean);
  const text = bounds.join(", ");
  return [about.description, text && `${text.charAt(0).toUpperCase()}${text.slice(1)}.`]
    .filter(Boolean)
    .join(" ");
}

function plain(number) {
  return number.toLocaleString("en", { maximumFractionDigits: 6, useGrouping: false });
}
