// Elements without a framework: make, replace, find.

const SVG = "http://www.w3.org/2000/svg";

function fill(node, props, kids) {
  for (const [name, value] of Object.entries(props)) {
    if (value === null || value === undefined || value === false) continue;
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (name === "style") for (const [key, of] of Object.entries(value)) node.style.setProperty(key, of);
    else if (name === "value" || name === "checked" || name === "selected") node[name] = value;
    else node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...kids.flat(Infinity).filter((kid) => kid !== null && kid !== undefined && kid !== false));
  return node;
}

/** Make an element: h("button", {class: "plain", onclick: f}, "Add"). Text is never read as markup. */
export const h = (tag, props = {}, ...kids) => fill(document.createElement(tag), props, kids);

/** Make an element of a drawing. */
export const svg = (tag, props = {}, ...kids) => fill(document.createElementNS(SVG, tag), props, kids);

export const byId = (id) => document.getElementById(id);

/** Give an element other children, only where its text or structure is another: focus stays. */
export function replace(node, ...kids) {
  const focused = node.contains(document.activeElement) ? document.activeElement.dataset.testid : null;
  node.replaceChildren(...kids.flat(Infinity).filter((kid) => kid !== null && kid !== undefined && kid !== false));
  if (focused) node.querySelector(`[data-testid="${CSS.escape(focused)}"]`)?.focus({preventScroll: true});
}

/** Whether the reader wants things to stand still. */
export const still = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

/** A picture of a button; its name is said by the button. */
export function icon(name) {
  const paths = {
    undo: "M6 3 2.5 6.5 6 10M3 6.5h6.5a4 4 0 0 1 0 8H6",
    redo: "M10 3l3.5 3.5L10 10M13 6.5H6.5a4 4 0 0 0 0 8H10",
    close: "M4 4l8 8M12 4l-8 8",
    plus: "M8 3v10M3 8h10",
    theme: "M8 2a6 6 0 1 0 0 12zM8 2a6 6 0 0 1 0 12",
    hold: "M5 7V5a3 3 0 0 1 6 0v2M4 7h8v6H4z",
    free: "M5 7V5a3 3 0 0 1 5.6-1.5M4 7h8v6H4z",
    down: "M8 2v8M4.5 7 8 10.5 11.5 7M3 13.5h10",
  };
  return svg("svg", {viewBox: "0 0 16 16", class: "icon", "aria-hidden": "true"},
    svg("path", {d: paths[name]}));
}
