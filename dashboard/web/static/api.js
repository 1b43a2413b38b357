/** Requests to the daemon. A refusal is an Error whose message says what and how to mend it. */

/** A problem document of the server. */
export class Problem extends Error {
  /** @param {number} status @param {any} document */
  constructor(status, document) {
    super([document.detail ?? document.title ?? `The server answered HTTP ${status}.`, document.mend].filter(Boolean).join("; "));
    this.status = status;
  }
}

/** The JSON of an answer. @param {string} url @param {RequestInit} [options] @returns {Promise<any>} */
export async function getJson(url, options = {}) {
  const answer = await fetch(url, options).catch((error) => {
    // A browser says it in its own words, as "Failed to fetch".
    throw error instanceof TypeError ? new TypeError("the page's server does not answer") : error;
  });
  const body = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Problem(answer.status, body);
  return body;
}

/** The address of one subject's answer, at a moment if one is given. @param {string} table @param {string} id @param {number|null} t */
export function subjectUrl(table, id, t = null, tail = "") {
  return `api/${table}/${encodeURIComponent(id)}${tail}${t === null ? "" : `?t=${Math.round(t)}`}`;
}
