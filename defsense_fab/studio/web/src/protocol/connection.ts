// The socket to the server: requests with their answers, events as signals, arrays by name.
import { type ReadonlySignal, signal } from "@preact/signals";
import type { Problem, Protocol } from "./messages";

type Request = Protocol["request"];
type RequestKind = Request["kind"];
type Events = Protocol["event"];
type EventKind = Exclude<Events["kind"], "reply">;
type EventOf<K extends EventKind> = Extract<Events, { kind: K }>;
type Content<K extends RequestKind> = Omit<Extract<Request, { kind: K }>, "kind" | "id">;

export type NumberArray = Float32Array | Uint32Array | Uint8Array;

/** Arrays that the server has sent under a name, with their shapes and some facts. */
export interface ArrayMessage {
  name: string;
  arrays: Record<string, NumberArray>;
  shapes: Record<string, number[]>;
  // biome-ignore lint: the sender of each name declares what its facts are
  facts: Record<string, any>;
}

/** A request that the server refused. */
export class Refusal extends Error {
  constructor(readonly problem: Problem) {
    super(problem.text);
  }
}

interface Waiting {
  resolve: (value: unknown) => void;
  reject: (error: Error) => void;
}

const RECONNECT_MS = 1000;
const UPLOAD_PART_BYTES = 512 * 1024;

export class Connection {
  /** Whether the server answers; false also before the first connection. */
  readonly isOpen = signal(false);
  /** Whether a connection was open before and is lost. */
  readonly isLost = signal(false);

  private socket: WebSocket | null = null;
  private next = 1;
  private readonly waiting = new Map<number, Waiting>();
  private readonly events = new Map<string, ReturnType<typeof signal<unknown>>>();
  private readonly listeners = new Map<string, Set<(event: never) => void>>();
  private readonly arrayListeners = new Map<string, Set<(message: ArrayMessage) => void>>();
  private readonly lastArrays = new Map<string, ArrayMessage>();

  /** `reviver` reads the values of messages, as that of JSON.parse does. */
  constructor(
    private readonly url: string,
    private readonly reviver?: (this: unknown, key: string, value: unknown) => unknown,
  ) {
    this.open();
  }

  /** The last event of a kind, or null before the first one. */
  event<K extends EventKind>(kind: K): ReadonlySignal<EventOf<K> | null> {
    return this.eventSignal(kind) as ReadonlySignal<EventOf<K> | null>;
  }

  /** Call a function with each event of a kind, also with equal ones; return a function to stop. */
  listen<K extends EventKind>(kind: K, action: (event: EventOf<K>) => void): () => void {
    return add(this.listeners, kind, action as (event: never) => void);
  }

  /** Call a function with the arrays of a name, now and whenever they change. */
  onArrays(name: string, action: (message: ArrayMessage) => void): () => void {
    const last = this.lastArrays.get(name);
    if (last) action(last);
    return add(this.arrayListeners, name, action);
  }

  /** Send a request and return its answer; throws a Refusal. Arrays come as an ArrayMessage. */
  send<K extends RequestKind>(kind: K, content: Content<K>): Promise<Protocol["results"][K]> {
    return this.post({ kind, ...content }) as Promise<Protocol["results"][K]>;
  }

  /** Send a request that is answered by arrays. */
  fetch<K extends RequestKind>(kind: K, content: Content<K>): Promise<ArrayMessage> {
    return this.post({ kind, ...content }) as Promise<ArrayMessage>;
  }

  /** Upload a file in parts; report the share that is sent. Throws a Refusal. */
  async upload(file: File, onProgress: (share: number) => void): Promise<void> {
    const id = this.next;
    const answer = this.post({ kind: "upload", name: file.name, size: file.size });
    let isRefused = false;
    answer.catch(() => (isRefused = true));
    for (let at = 0; at < file.size && !isRefused; at += UPLOAD_PART_BYTES) {
      const part = new Uint8Array(await file.slice(at, at + UPLOAD_PART_BYTES).arrayBuffer());
      const message = new Uint8Array(4 + part.length);
      new DataView(message.buffer).setUint32(0, id, true);
      message.set(part, 4);
      this.socket?.send(message);
      while ((this.socket?.bufferedAmount ?? 0) > 4 * UPLOAD_PART_BYTES) await pause(20);
      onProgress(Math.min(1, (at + part.length) / file.size));
    }
    await answer;
  }

  private post(content: { kind: string; [key: string]: unknown }): Promise<unknown> {
    const id = this.next++;
    return new Promise((resolve, reject) => {
      if (this.socket?.readyState !== WebSocket.OPEN) {
        const text = "The server does not answer";
        reject(new Refusal({ code: "not-connected", text, message: text, field: "", cord: "", suggestion: null }));
        return;
      }
      this.waiting.set(id, { resolve, reject });
      this.socket.send(JSON.stringify({ ...content, id }));
    });
  }

  private open(): void {
    const socket = new WebSocket(this.url);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.isOpen.value = true;
      this.isLost.value = false;
    };
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") this.receive(JSON.parse(data, this.reviver));
      else this.receiveArrays(data);
    };
    socket.onclose = () => {
      if (this.isOpen.value) this.isLost.value = true;
      this.isOpen.value = false;
      for (const { reject } of this.waiting.values()) reject(new Error("The connection was lost"));
      this.waiting.clear();
      setTimeout(() => this.open(), RECONNECT_MS);
    };
    this.socket = socket;
  }

  private receive(event: Events): void {
    if (event.kind !== "reply") {
      this.eventSignal(event.kind).value = event;
      for (const action of this.listeners.get(event.kind) ?? []) action(event as never);
      return;
    }
    const waiting = this.waiting.get(event.id);
    this.waiting.delete(event.id);
    if (event.problem) waiting?.reject(new Refusal(event.problem));
    else waiting?.resolve(event.result);
  }

  private receiveArrays(data: ArrayBuffer): void {
    const length = new DataView(data).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    const message: ArrayMessage = { name: header.name, arrays: {}, shapes: {}, facts: header.facts };
    for (const { name, type, shape, at } of header.arrays) {
      const size = shape.reduce((a: number, b: number) => a * b, 1);
      const Type = { float32: Float32Array, uint32: Uint32Array, uint8: Uint8Array }[type as string]!;
      message.arrays[name] = new Type(data, 4 + length + at, size);
      message.shapes[name] = shape;
    }
    if (header.id !== null) {
      this.waiting.get(header.id)?.resolve(message);
      this.waiting.delete(header.id);
      return;
    }
    this.lastArrays.set(message.name, message);
    for (const action of this.arrayListeners.get(message.name) ?? []) action(message);
  }

  private eventSignal(kind: string): ReturnType<typeof signal<unknown>> {
    let found = this.events.get(kind);
    if (!found) this.events.set(kind, (found = signal<unknown>(null)));
    return found;
  }
}

function pause(ms: number): Promise<void> {
  return new Promise((resolve) => setTimeout(resolve, ms));
}

function add<T>(listeners: Map<string, Set<T>>, name: string, action: T): () => void {
  const actions = listeners.get(name) ?? new Set<T>();
  listeners.set(name, actions.add(action));
  return () => actions.delete(action);
}
