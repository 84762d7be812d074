// The WebSocket to the server: requests with an id, their replies, and events. It connects again after an interruption.
import { signal } from "@preact/signals";
import type { Event, Fault, Reply } from "./protocol";

export class Refused extends Error {
  constructor(readonly fault: Fault) {
    super(fault.text);
  }
}

export const connected = signal<"opening" | "open" | "gone">("opening");
export const pending = signal(0); // number of requests without a reply so far
const waiting = new Map<number, { resolve: (reply: Reply) => void; reject: (why: Refused) => void }>();
const listeners = new Set<(event: Event) => void>();
let socket: WebSocket | null = null;
let last = 0;
let pause = 300;

/** Calls `hear` with every event of the server. */
export function listen(hear: (event: Event) => void): void {
  listeners.add(hear);
}

/** Sends a request and returns its reply; throws `Refused` with the server's sentence if it is refused. */
export function ask(verb: string, what: object = {}): Promise<Reply> {
  if (!socket || socket.readyState !== WebSocket.OPEN) {
    return Promise.reject(new Refused({ text: "The studio's server does not answer. The page tries again by itself." }));
  }
  const id = ++last;
  const here = socket;
  return new Promise((resolve, reject) => {
    waiting.set(id, { resolve, reject });
    pending.value = waiting.size;
    here.send(JSON.stringify({ ...what, id, do: verb }));
  });
}

/** Opens the socket and keeps it open; `greet` runs after every opening. */
export function connect(greet: () => void): void {
  const token = new URLSearchParams(location.search).get("token") ?? "";
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const here = new WebSocket(`${scheme}://${location.host}/socket?token=${encodeURIComponent(token)}`);
  socket = here;
  here.onopen = () => {
    pause = 300;
    connected.value = "open";
    greet();
  };
  here.onmessage = (message) => {
    const said = JSON.parse(String(message.data)) as (Reply | { id: number; ok: false; error: Fault }) & Partial<Event>;
    if (typeof said.event === "string") {
      for (const hear of listeners) hear(said as unknown as Event);
      return;
    }
    const asked = waiting.get(said.id);
    waiting.delete(said.id);
    pending.value = waiting.size;
    if (said.ok) asked?.resolve(said as Reply);
    else asked?.reject(new Refused((said as { error: Fault }).error));
  };
  here.onclose = () => {
    connected.value = "gone";
    const text = "The studio's server has gone.";
    for (const asked of waiting.values()) asked.reject(new Refused({ text }));
    waiting.clear();
    pending.value = 0;
    setTimeout(() => connect(greet), pause);
    pause = Math.min(pause * 1.7, 5000);
  };
}
