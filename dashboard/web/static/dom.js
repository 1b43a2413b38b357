/** Elements made of values. Text from data only ever becomes text nodes or attributes. */

const SVG = "http://www.w3.org/2000/svg";

/**
 * Makes an HTML element.
 * @param {string} tag name with classes, as in "td.num"
 * @param {Object<string, any>} [props] attributes; null and false leave one out, true gives it no value
 * @param {...any} children nodes, strings, numbers, arrays of them; null and false are left out
 * @returns {HTMLElement}
 */
export function h(tag, props = {}, ...children) {
  return /** @type {HTMLElement} */ (build(null, tag, props, children));
}

/** Makes an SVG element, as `h` does. @returns {SVGElement} */
export function s(tag, props = {}, ...children) {
  return /** @type {any} */ (build(SVG, tag, props, children));
}

function build(space, tag, props, children) {
  const [name, ...classes] = tag.split(".");
  const node = space ? document.createElementNS(space, name) : document.createElement(name);
  if (classes.length) node.setAttribute("class", classes.join(" "));
  for (const [key, value] of Object.entries(props ?? {})) {
    if (value === null || value === undefined || value === false) continue;
    node.setAttribute(key, value === true ? "" : String(value));
  }
  append(node, children);
  return node;
}

function append(node, children) {
  for (const child of children) {
    if (child === null || child === undefined || child === false) continue;
    if (Array.isArray(child)) append(node, child);
    else node.append(child instanceof Node ? child : String(child));
  }
}

/** An icon of the sprite; it has no name of its own. @param {string} name */
export function icon(name) {
  return s("svg.icon", { "aria-hidden": "true", viewBox: "0 0 16 16" }, s("use", { href: `static/icons.svg#${name}` }));
}

/**
 * Makes the children of `target` equal to those of `source`, and keeps the nodes that are equal already: focus, scrolling
 * and running pictures survive. Listeners belong on an ancestor. A child with `data-keep` is left as it is.
 * @param {Element} target
 * @param {Node} source
 */
export function morph(target, source) {
  const wanted = [...source.childNodes];
  for (let i = 0; i < wanted.length; i += 1) {
    const old = target.childNodes[i];
    const fresh = wanted[i];
    if (!old) target.append(fresh);
    else if (!alike(old, fresh)) target.replaceChild(fresh, old);
    else if (fresh instanceof Element) mendElement(/** @type {Element} */ (old), fresh);
    else if (old.nodeValue !== fresh.nodeValue) old.nodeValue = fresh.nodeValue;
  }
  while (target.childNodes.length > wanted.length) target.lastChild?.remove();
}

function alike(a, b) {
  if (a.nodeName !== b.nodeName) return false;
  return !(a instanceof Element) || a.getAttribute("data-key") === b.getAttribute("data-key");
}

function mendElement(old, fresh) {
  if (old.hasAttribute("data-keep")) return;
  for (const { name } of [...old.attributes]) {
    // Whether a reader opened it is theirs to say.
    if (!fresh.hasAttribute(name) && name !== "open") old.removeAttribute(name);
  }
  for (const { name, value } of [...fresh.attributes]) {
    if (old.getAttribute(name) !== value && name !== "open") old.setAttribute(name, value);
  }
  morph(old, fresh);
}

/** Sets a text where it differs. @param {Element} node @param {string} text */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** The element of an id that index.html has. @param {string} id @returns {any} */
export function byId(id) {
  const node = document.getElementById(id);
  if (!node) throw new Error(`index.html has no #${id}`);
  return node;
}
