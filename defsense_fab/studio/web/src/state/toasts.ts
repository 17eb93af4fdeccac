// Short messages that disappear by themselves.
import { signal } from "@preact/signals";
import type { Problem } from "../protocol/messages";
import { connection } from "./connection";
import { remedyOf } from "./remedies";

export interface Toast {
  id: number;
  text: string;
  isError: boolean;
  action: ToastAction | null;
}

export interface ToastAction {
  label: string;
  run: () => void;
}

const MAX_TOASTS = 4;

export const toasts = signal<readonly Toast[]>([]);

let lastId = 0;

/** Show a message; an equal one that is still shown is replaced. */
export function showToast(text: string, action: ToastAction | null = null, isError = false): void {
  const others = toasts.value.filter((toast) => toast.text !== text);
  toasts.value = [...others, { id: ++lastId, text, isError, action }].slice(-MAX_TOASTS);
}

/** Show an error, with the button that cures it. */
export function showProblem(problem: Problem): void {
  showToast(problem.text, remedyOf(problem), true);
}

export function dismissToast(id: number): void {
  toasts.value = toasts.value.filter((toast) => toast.id !== id);
}

// An error of a request belongs to the device and its file as they were then.
function dismissErrors(): void {
  toasts.value = toasts.value.filter(({ isError }) => !isError);
}

connection.listen("device-state", dismissErrors);
connection.listen("page", dismissErrors);

connection.listen("notice", ({ text, problem }) => {
  if (problem) showProblem(problem);
  else showToast(text);
});
