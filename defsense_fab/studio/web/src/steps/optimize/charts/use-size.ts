import type { RefObject } from "preact";
import { useEffect, useState } from "preact/hooks";

/** The size of an element in pixels, which follows the page. */
export function useSize(element: RefObject<HTMLElement | null>): [number, number] {
  const [size, setSize] = useState<[number, number]>([0, 0]);
  useEffect(() => {
    const observed = element.current!;
    const observer = new ResizeObserver(() => setSize([observed.clientWidth, observed.clientHeight]));
    observer.observe(observed);
    return () => observer.disconnect();
  }, []);
  return size;
}
