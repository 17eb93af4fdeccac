// Requests of a card, whose refusals are shown in the card.
import { type Signal, useSignal } from "@preact/signals";
import type { Problem } from "../../protocol/messages";
import { attempt } from "../../state/run";

export interface CardRequest {
  problem: Signal<Problem | null>;
  /** Wait for a request; return whether it was accepted. */
  send: (request: Promise<unknown>) => Promise<boolean>;
}

export function useRequest(): CardRequest {
  const problem = useSignal<Problem | null>(null);
  const send = async (request: Promise<unknown>) => {
    problem.value = null;
    await attempt(request, (refused) => (problem.value = refused));
    return problem.value === null;
  };
  return { problem, send };
}
