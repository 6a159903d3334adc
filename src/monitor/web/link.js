/**
 * The way to the server: one WebSocket for states, events and commands, plain HTTP for all that is asked for once.
 *
 * Events of a {@link Link}: `open`, `closed`, `state`, `event`, `unauthorized`; what came is in `detail`, for `closed` whether the server
 * went away on purpose.
 * The socket is opened again for as long as the page lives. A refused command is a {@link Refusal} with words for people.
 */

const API = "/api/v1";
const STATE_RATE_HZ = 60;
const REPLY_TIMEOUT_MS = 3000;
/** An answer over HTTP, and one that is a file. */
const TIMEOUT_MS = 30_000;
const FILE_TIMEOUT_MS = 300_000;
const RETRY_LEAST_MS = 250;
const RETRY_MOST_MS = 2000;
/** A ping goes out this often; a socket on which nothing came for three of them is dead. */
const PING_MS = 2000;
/** The code with which a server closes that goes away (RFC 6455). */
const AWAY = 1001;

/** Why the server did not do what was asked, and what to do about it. */
export class Refusal extends Error {
  /** @param {string} message @param {string=} hint @param {number=} status */
  constructor(message, hint = "", status = 0) {
    super(message);
    this.hint = hint;
    this.status = status;
  }
}

/** The server has not said whether it did it. */
export class NoAnswer extends Refusal {}

/** @typedef {{resolve: (reply: object) => void, reject: (why: Error) => void, timer: number}} Waiting */

export class Link extends EventTarget {
  /** @param {?string} token what a server on another address than loopback asks for */
  constructor(token) {
    super();
    this.token = token;
    /** @type {?WebSocket} */
    this.socket = null;
    this.retryMs = RETRY_LEAST_MS;
    this.nextId = 1;
    /** @type {Map<number, Waiting>} */
    this.waiting = new Map();
    this.heardAt = 0;
    setInterval(() => this.#ping(), PING_MS);
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Opens the socket, and again whenever it closes. */
  connect() {
    const url = new URL(`${API}/ws`, location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    url.hash = "";
    if (this.token) url.searchParams.set("token", this.token);
    const socket = new WebSocket(url);
    this.socket = socket;
    socket.onmessage = ({ data }) => this.#take(JSON.parse(data));
    socket.onclose = ({ code }) => {
      if (this.socket === socket) this.#lost(code === AWAY);
    };
  }

  /**
   * Asks for something on the socket.
   * @param {string} what the command
   * @param {object=} fields
   * @param {number=} timeoutMs how long to wait for the reply
   * @returns {Promise<object>} the reply
   */
  send(what, fields = {}, timeoutMs = REPLY_TIMEOUT_MS) {
    if (!this.isOpen) return Promise.reject(new Refusal("no connection to the server"));
    const id = this.nextId++;
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        this.waiting.delete(id);
        reject(new NoAnswer(`no answer to ${what}`, "the server is busy or gone"));
      }, timeoutMs);
      this.waiting.set(id, { resolve, reject, timer });
      this.socket.send(JSON.stringify({ id, do: what, ...fields }));
    });
  }

  /** Enable, disable or stop; over HTTP while the socket is down. @param {"enable"|"disable"|"stop"} what */
  order(what) {
    return this.isOpen ? this.send(what) : this.post(what);
  }

  /** @param {string} path below the API's root, or an absolute path */
  async get(path) {
    return (await this.#fetch("GET", path)).json();
  }

  /** @param {string} path @returns {Promise<ArrayBuffer>} */
  async getBytes(path) {
    return (await this.#fetch("GET", path)).arrayBuffer();
  }

  /** A file, which may take as long as the server allows a connection. @param {string} path @returns {Promise<Blob>} */
  async getFile(path) {
    return (await this.#fetch("GET", path, undefined, FILE_TIMEOUT_MS)).blob();
  }

  /** @param {string} path @param {object=} body */
  async post(path, body) {
    await this.#fetch("POST", path, body);
  }

  /** A file goes to the server, or what it knows of one is forgotten. @param {"PUT"|"DELETE"} method @param {string} path @param {Blob=} file */
  async sendFile(method, path, file) {
    await this.#fetch(method, path, file, FILE_TIMEOUT_MS);
  }

  /** @param {string} method @param {string} path @param {(object|Blob)=} body @param {number=} timeoutMs */
  async #fetch(method, path, body, timeoutMs = TIMEOUT_MS) {
    const headers = {};
    const isFile = body instanceof Blob;
    if (this.token) headers.Authorization = `Bearer ${this.token}`;
    if (body && !isFile) headers["Content-Type"] = "application/json";
    let response;
    try {
      response = await fetch(path.startsWith("/") ? path : `${API}/${path}`, {
        method,
        headers,
        body: isFile ? body : body && JSON.stringify(body),
        signal: AbortSignal.timeout(timeoutMs),
      });
    } catch {
      throw new Refusal("no connection to the server");
    }
    if (response.ok) return response;
    if (response.status === 401) this.#tell("unauthorized");
    const { error, hint } = await response.json().catch(() => ({}));
    throw new Refusal(error ?? `the server answered ${response.status}`, hint, response.status);
  }

  #take(message) {
    this.heardAt = performance.now();
    switch (message.type) {
      case "hello":
        this.retryMs = RETRY_LEAST_MS;
        this.send("subscribe", { rate_hz: STATE_RATE_HZ, format: "json", contacts: true }).catch(() => this.socket.close());
        this.#tell("open", message);
        break;
      case "reply": {
        const waiting = this.waiting.get(message.id);
        if (!waiting) break;
        this.waiting.delete(message.id);
        clearTimeout(waiting.timer);
        if (message.ok) waiting.resolve(message);
        else waiting.reject(new Refusal(message.error, message.hint));
        break;
      }
      default:
        this.#tell(message.type, message);
    }
  }

  /** @param {boolean} isOver */
  #lost(isOver) {
    this.socket = null;
    for (const { reject, timer } of this.waiting.values()) {
      clearTimeout(timer);
      reject(new NoAnswer("the connection broke"));
    }
    this.waiting.clear();
    this.#tell("closed", isOver);
    setTimeout(() => this.connect(), this.retryMs);
    this.retryMs = Math.min(2 * this.retryMs, RETRY_MOST_MS);
  }

  #ping() {
    if (!this.isOpen) return;
    if (performance.now() - this.heardAt > 3 * PING_MS) {
      // A dead peer may keep close() waiting for minutes.
      const socket = this.socket;
      this.#lost(false);
      socket.close();
    } else {
      this.send("ping").catch(() => {});
    }
  }

  #tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }
}

/** The token of this page's address, kept for this tab only and taken out of the address bar. @returns {?string} */
export function tokenOfAddress() {
  const url = new URL(location.href);
  const token = url.searchParams.get("token") ?? new URLSearchParams(url.hash.slice(1)).get("token");
  if (!token) return sessionStorage.getItem("token");
  sessionStorage.setItem("token", token);
  url.searchParams.delete("token");
  url.hash = "";
  history.replaceState(null, "", url);
  return token;
}
