import type { ComponentChildren } from "preact";
import type { Problem, TaskStatus } from "../../protocol/messages";
import { GuidedScreen } from "../../live/guided-screen";
import { RemedyButton } from "../../shell/remedy-button";
import { isJobActive } from "../../state/connection";
import { Icon } from "../../ui/icons";
import type { CardRequest } from "./request";
import { NextCardButton } from "./next-card";
import { type CardName, CARD_LABELS, choices, guided, status } from "./state";

interface CardFrameProps {
  name: CardName;
  lead: ComponentChildren;
  children: ComponentChildren;
}

/** A card: its title, a sentence, and what can be set; or its guided run. */
export function CardFrame({ name, lead, children }: CardFrameProps) {
  const task = status.value?.[name];
  const run = guided.value;
  const isGuiding = task?.state === "running" && Boolean(run?.run);
  return (
    <article class="measure-card" aria-labelledby={`card-${name}`}>
      <header>
        <h2 id={`card-${name}`}>{CARD_LABELS[name]}</h2>
        {!isGuiding && <p>{lead}</p>}
      </header>
      {isGuiding && run ? <GuidedScreen state={run} /> : children}
      {!isGuiding && <NextCardButton name={name} />}
    </article>
  );
}

interface CardMessageProps {
  request: CardRequest;
  task: TaskStatus | undefined;
}

/** Why the last request was refused; else what the task does, or how it ended. */
export function CardMessage({ request, task }: CardMessageProps) {
  const refused = request.problem.value;
  return refused ? <ProblemMessage problem={refused} /> : <TaskMessage task={task} />;
}

function TaskMessage({ task }: { task: TaskStatus | undefined }) {
  if (task?.problem) return <ProblemMessage problem={task.problem} />;
  if (!task?.text) return null;
  return (
    <p class="task-message" role="status">
      {task.state === "idle" ? (
        <Icon name={task.code === "cancelled" ? "info" : "check"} />
      ) : (
        <span class="spinner" aria-hidden="true" />
      )}
      <span>{task.text}</span>
    </p>
  );
}

export function ProblemMessage({ problem }: { problem: Problem }) {
  return (
    <p class="task-message problem" role="alert">
      <Icon name="error" />
      <span>{problem.text}</span>
      <RemedyButton problem={problem} />
    </p>
  );
}

/** Why the work of a card cannot start now; empty if it can. */
export function obstacleOf({ needsBuild }: { needsBuild: boolean }): string {
  if (isJobActive.value) return "Wait until the running job has ended.";
  if (needsBuild && !choices.value?.isBuilt) return "The parts are not built yet: build them in Make first.";
  return "";
}

/** Why a button above is disabled. */
export function Obstacle({ text }: { text: string }) {
  if (!text) return null;
  return (
    <p class="task-message">
      <Icon name="info" />
      <span>{text}</span>
    </p>
  );
}

/** A warning that does not stop anything. */
export function Warning({ children }: { children: ComponentChildren }) {
  return (
    <p class="task-message warning">
      <Icon name="warning" />
      <span>{children}</span>
    </p>
  );
}
