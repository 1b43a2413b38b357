/** The live stream: server-sent events read by fetch, as EventSource hides heartbeats, by which silence is noticed. */

export const SILENT_MS = 4000;
const RETRY_MS = [500, 1000, 2000, 4000];

/**
 * Reads server-sent events from chunks of text. Comments and unknown fields are dropped.
 * @param {(event: string, data: string) => void} onEvent
 * @returns {(chunk: string) => void}
 */
export function eventParser(onEvent) {
  let rest = "";
  let event = "message";
  /** @type {string[]} */
  let data = [];
  return (chunk) => {
    const lines = (rest + chunk).split(/\r\n|\n/);
    rest = /** @type {string} */ (lines.pop());
    for (const line of lines) {
      if (line === "") {
        if (data.length) onEvent(event, data.join("\n"));
        event = "message";
        data = [];
      } else if (line.startsWith("event:")) event = line.slice(6).trim();
      else if (line.startsWith("data:")) data.push(line.slice(5).trimStart());
    }
  };
}

/** Keeps a stream of moments and deltas open. */
export class LiveStream {
  /**
   * @param {string} url
   * @param {{onMoment: (moment: any) => void, onDelta: (delta: any) => void, onState: (up: boolean) => void}} handlers
   */
  constructor(url, handlers) {
    this.url = url;
    this.handlers = handlers;
    this.failures = 0;
    addEventListener("online", () => this._now?.());
    this._run();
  }

  async _run() {
    for (;;) {
      try {
        await this._read(new AbortController());
      } catch (error) {
        if (!(error instanceof TypeError) && error?.name !== "AbortError") console.warn(`live stream: ${error}`);
      }
      this.handlers.onState(false);
      const wait = RETRY_MS[Math.min(this.failures, RETRY_MS.length - 1)];
      this.failures += 1;
      await new Promise((resolve) => {
        this._now = () => resolve(null);
        setTimeout(resolve, wait);
      });
    }
  }

  async _read(abort) {
    let watchdog = setTimeout(() => abort.abort(), SILENT_MS);
    const parse = eventParser((event, text) => this._take(event, text));
    try {
      const answer = await fetch(this.url, { signal: abort.signal, cache: "no-store", headers: { Accept: "text/event-stream" } });
      if (!answer.ok || !answer.body) throw new Error(`HTTP ${answer.status}`);
      const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
      for (;;) {
        const { done, value } = await reader.read();
        if (done) return;
        clearTimeout(watchdog);
        watchdog = setTimeout(() => abort.abort(), SILENT_MS);
        parse(value);
      }
    } finally {
      clearTimeout(watchdog);
    }
  }

  _take(event, text) {
    const value = JSON.parse(text);
    if (event === "moment") {
      this.failures = 0;
      this.handlers.onMoment(value);
      this.handlers.onState(true);
    } else if (event === "delta") this.handlers.onDelta(value);
  }
}
