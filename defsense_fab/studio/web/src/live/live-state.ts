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

const TEXT_INTERVAL_MS = 200;

interface FrameHandlers {
  /** Called with each frame that arrives. */
  onReceive: (frame: Frame) => void;
  /** Called with the newest frame before the browser draws. */
  onShow: (frame: Frame) => void;
}

/** Ask for frames while a component is mounted, also after the connection was lost. */
export function useFrames({ onReceive, onShow }: FrameHandlers): void {
  useEffect(() => {
    let shownAt = 0;
    let newest: Frame | null = null;
    let drawing = 0;
    const draw = () => {
      drawing = 0;
      if (!newest) return;
      onShow(newest);
      if (performance.now() - shownAt < TEXT_INTERVAL_MS) return;
      shownAt = performance.now();
      shownFrame.value = newest;
    };
    const watch = (isWatching: boolean) =>
      connection.send("watch-live", { isWatching }).catch(() => undefined);
    const stopFrames = connection.onArrays("live-frame", (message: ArrayMessage) => {
      newest = readFrame(message);
      onReceive(newest);
      drawing ||= requestAnimationFrame(draw);
    });
    const stopOpen = connection.isOpen.subscribe((isOpen) => {
      if (isOpen) void watch(true);
    });
    return () => {
      cancelAnimationFrame(drawing);
      stopFrames();
      stopOpen();
      shownFrame.value = null;
      if (connection.isOpen.value) void watch(false);
    };
  }, []);
}
