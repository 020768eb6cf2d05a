// Making and changing elements, for both pages. All data is text, never HTML.
const SVG = "http://www.w3.org/2000/svg", COPIED_MS = 2000;

export const $ = (id) => document.getElementById(id);
export function make(tag, name = "", ...children) {
  const node = document.createElement(tag);
  if (name) node.className = name;
  node.append(...children);
  return node;
}
export function draw(tag, attributes, ...children) {
  const node = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}
export function button(text, act, name = "") {
  const node = make("button", name, text);
  node.type = "button";
  node.addEventListener("click", act);
  return node;
}

/* Changing: only what differs is touched, so that nothing flickers and the focus stays. */
export const put = (node, text) => { if (node.textContent !== text) node.textContent = text; };
export const mark = (node, key, value) => { if (node.dataset[key] !== value) node.dataset[key] = value; };
export const hide = (node, hidden) => { if (node.hidden !== hidden) node.hidden = hidden; };
export function attribute(node, key, value) {
  if (node.getAttribute(key) !== String(value)) node.setAttribute(key, value);
}
export function share(node, value) {
  if (node.shown !== value) { node.shown = value; node.style.setProperty("--share", value); }
}
/* Makes `nodes` the children of `list`. */
export function keep(list, nodes) {
  const wanted = new Set(nodes);
  for (const old of [...list.children]) if (!wanted.has(old)) old.remove();
  nodes.forEach((node, i) => { if (list.children[i] !== node) list.insertBefore(node, list.children[i] || null); });
}
/* Adds or removes rows at the end of `list` until there are `number`. */
export function rowsOf(list, number, row) {
  while (list.children.length > number) list.lastChild.remove();
  while (list.children.length < number) list.append(row());
  return [...list.children];
}
/* Builds the content of a node anew only if `value` has changed, so that nothing moves under a finger. */
export function part(node, value, build) {
  const text = JSON.stringify(value);
  if (node.dataset.built === text) return;
  node.dataset.built = text;
  node.replaceChildren(...build());
}

/* A sentence, and the command that it asks for, with a button that copies it. advice: [sentence, command] or null. */
export function showAdvice(node, advice) {
  hide(node, !advice);
  if (advice) part(node, advice, () => [make("p", "", advice[0]), ...(advice[1] ? [command(advice[1])] : [])]);
}
export function command(text) {
  const code = make("code", "", text), copy = button("Copy", async () => {
    const done = await copied(text, code);
    copy.textContent = done ? "Copied" : "Select it";
    setTimeout(() => { copy.textContent = "Copy"; }, COPIED_MS);
  });
  copy.setAttribute("aria-label", `Copy ${text}`);
  return make("div", "command", code, copy);
}
/* Pages of plain HTTP have no clipboard: there the text is selected, and copied as by the keyboard. */
async function copied(text, node) {
  try { await navigator.clipboard.writeText(text); return true; } catch { /* the older way */ }
  getSelection().selectAllChildren(node);
  return document.execCommand("copy");
}

/* What the browser remembers; some have no storage. */
export function stored(name) { try { return localStorage.getItem(name) || ""; } catch { return ""; } }
export function store(name, value) {
  try { if (value) localStorage.setItem(name, value); else localStorage.removeItem(name); } catch { /* no storage */ }
}
