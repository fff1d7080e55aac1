// Questions to the local server, over one websocket; each answer has the number of its question.

import { UserError } from "../../page/assets/safetensors.js";

const BUSY = 4001; // `socialiq.view.server.BUSY`
const ATTEMPTS = 4; // while a tab that was just reloaded still has the policy
const PAUSE = 300; // ms between them

export const STOPPED = "The server has stopped: start `socialiq view` again and open the address that it prints.";
const SECOND = "Another tab has this policy: close it, then reload this page.";

export class Connection {
  /** @param {(line: string) => void} lost Called once with the reason when the server is lost. */
  constructor(lost) {
    Object.assign(this, { lost, asked: 0, attempts: 0, waiting: new Map(), fault: "" });
    this.open();
  }

  open() {
    const { host, pathname } = window.location;
    this.attempts += 1;
    this.ready = new Promise((resolve) => {
      this.socket = new WebSocket(`ws://${host}${pathname}decide`);
      this.socket.onopen = resolve;
    });
    this.socket.onmessage = ({ data }) => this.answered(JSON.parse(data));
    this.socket.onclose = ({ code }) => this.closed(code);
  }

  answered({ number, fault, ...answer }) {
    const waiting = this.waiting.get(number);
    this.waiting.delete(number);
    if (fault) waiting?.reject(new UserError(fault));
    else waiting?.resolve(answer);
  }

  closed(code) {
    const questions = [...this.waiting.values()];
    if (code === BUSY && this.attempts < ATTEMPTS) {
      window.setTimeout(() => {
        this.open();
        this.ready.then(() => questions.forEach(({ text }) => this.socket.send(text)));
      }, PAUSE);
      return;
    }
    this.fault = code === BUSY ? SECOND : STOPPED;
    this.waiting.clear();
    questions.forEach(({ reject }) => reject(new UserError(this.fault)));
    this.lost(this.fault);
  }

  /** Return the answer to a question, an object. */
  ask(question) {
    if (this.fault) return Promise.reject(new UserError(this.fault));
    const number = (this.asked += 1);
    const text = JSON.stringify({ ...question, number });
    return new Promise((resolve, reject) => {
      this.waiting.set(number, { resolve, reject, text });
      const { socket } = this;
      this.ready.then(() => socket.readyState === WebSocket.OPEN && socket.send(text));
    });
  }
}

/** Return a part of the user's file, by its number. */
export async function partOf(number) {
  let answer;
  try {
    answer = await fetch(`part/${number}`);
  } catch {
    throw new UserError(STOPPED);
  }
  if (answer.status !== 200 && answer.status !== 422) throw new UserError(STOPPED);
  const found = await answer.json();
  if (found.fault) throw new UserError(found.fault);
  return found;
}
