// Requests whose refusal is shown where it belongs: in a field, or else as a message.
import { type Signal, signal } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { Refusal } from "../protocol/connection";
import type { Problem } from "../protocol/messages";
import { showProblem, showToast } from "./toasts";

const fields = new Map<string, Set<Signal<Problem | null>>>();

/** Wait for a request; show its refusal and return undefined. */
export async function run<T>(request: Promise<T>): Promise<T | undefined> {
  return attempt(request, showRefusal);
}

/** Show a refusal in its field, or else as a message. */
export function showRefusal(problem: Problem): void {
  const mounted = fields.get(problem.field);
  if (problem.field && mounted) for (const field of mounted) field.value = problem;
  else showProblem(problem);
}

/** Wait for a request; pass its refusal to a function and return undefined. */
export async function attempt<T>(
  request: Promise<T>,
  onRefused: (problem: Problem) => void,
): Promise<T | undefined> {
  try {
    return await request;
  } catch (error) {
    if (error instanceof Refusal) onRefused(error.problem);
    else showToast(error instanceof Error ? error.message : String(error), null, true);
    return undefined;
  }
}

/** The refusal of a key of `device.toml` that a field shows while it is mounted. */
export function useFieldProblem(key: string | undefined): Signal<Problem | null> {
  const problem = useMemo(() => signal<Problem | null>(null), []);
  useEffect(() => {
    if (!key) return undefined;
    const mounted = fields.get(key) ?? new Set();
    fields.set(key, mounted.add(problem));
    return () => {
      mounted.delete(problem);
      if (mounted.size === 0) fields.delete(key);
    };
  }, [key, problem]);
  return problem;
}
