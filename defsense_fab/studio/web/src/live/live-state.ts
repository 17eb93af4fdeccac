// The live device, its frames and its notes, as this browser gets them.
import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { ArrayMessage } from "../protocol/connection";
import { connection } from "../state/connection";
import { type Frame, readFrame } from "./frame";

export const liveDevice = connection.event("live-device");
export const liveNotes = connection.event("live-notes");

/** The newest frame, for texts; it is replaced a few times a second. */
export const shownFrame = signal<Frame | null>(null);

/** Whether the true shape of a simulated device is shown, too. */
export const isTruthShown = signal(true);

const TEXT_INTERVAL_MS = 200;

/** Receive frames while a component is mounted, also after the connection was lost. */
export function useFrames(onFrame: (frame: Frame) => void): void {
  useEffect(() => {
    let shownAt = 0;
    const watch = (isWatching: boolean) =>
      connection.send("watch-live", { isWatching }).catch(() => undefined);
    const stopFrames = connection.onArrays("live-frame", (message: ArrayMessage) => {
      const frame = readFrame(message);
      onFrame(frame);
      if (performance.now() - shownAt < TEXT_INTERVAL_MS) return;
      shownAt = performance.now();
      shownFrame.value = frame;
    });
    const stopOpen = connection.isOpen.subscribe((isOpen) => {
      if (isOpen) void watch(true);
    });
    return () => {
      stopFrames();
      stopOpen();
      shownFrame.value = null;
      if (connection.isOpen.value) void watch(false);
    };
  }, []);
}
