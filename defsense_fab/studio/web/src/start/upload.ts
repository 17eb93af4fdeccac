// The body that this browser uploads for a new device.
import { signal } from "@preact/signals";
import { Refusal } from "../protocol/connection";
import type { UploadedBody } from "../protocol/messages";
import { connection } from "../state/connection";

export type UploadState =
  | { name: "idle" }
  | { name: "sending"; file: string; share: number }
  | { name: "reading"; file: string }
  | { name: "failed"; text: string };

export const gallery = connection.event("gallery");

export const uploadState = signal<UploadState>({ name: "idle" });

/** The uploaded body, or null while none is uploaded. */
export const uploadedBody = signal<UploadedBody | null>(null);

const BYTES_PER_MB = 1024 * 1024;

/** Upload the first of some files, and describe its body. */
export async function uploadFirst(files: FileList | null | undefined): Promise<void> {
  const file = files?.[0];
  if (!file || uploadState.value.name === "sending" || uploadState.value.name === "reading") return;
  const limit = gallery.value?.maxUploadMb ?? Infinity;
  if (file.size > limit * BYTES_PER_MB) {
    fail(file.name, `it has ${Math.ceil(file.size / BYTES_PER_MB)} MB; the limit is ${limit} MB`);
    return;
  }
  if (file.size === 0) {
    fail(file.name, "it is empty");
    return;
  }
  uploadState.value = { name: "sending", file: file.name, share: 0 };
  try {
    await connection.upload(file, (share) => {
      uploadState.value =
        share < 1
          ? { name: "sending", file: file.name, share }
          : { name: "reading", file: file.name };
    });
    uploadedBody.value = await connection.send("describe-upload", { unit: null, size: null });
    uploadState.value = { name: "idle" };
  } catch (error) {
    const text = error instanceof Refusal ? error.problem.message : String(error);
    fail(file.name, `${text.charAt(0).toLowerCase()}${text.slice(1)}`);
  }
}

/** Leave the form of the uploaded body. */
export function leaveUpload(): void {
  uploadedBody.value = null;
  uploadState.value = { name: "idle" };
}

function fail(file: string, reason: string): void {
  const end = /[.!?]$/.test(reason) ? "" : ".";
  uploadState.value = { name: "failed", text: `${file} was refused: ${reason}${end}` };
}
