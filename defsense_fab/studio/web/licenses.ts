// The licenses of the packages in the page: in a file, and in three.js, which reports copy.
import type { Plugin } from "vite";
import lock from "./package-lock.json" with { type: "json" };

const FILE = "LICENSES.txt";
const RULE = "-".repeat(80);

/** Return a plugin that writes LICENSES.txt, and the license of three.js to its chunk. */
export function licenses(): Plugin {
  let root = "";
  return {
    name: "licenses",
    apply: "build",
    configResolved: (config) => void (root = config.root),
    async generateBundle(_options, bundle) {
      const read = (name: string) =>
        this.fs.readFile(`${root}/node_modules/${name}/LICENSE`, { encoding: "utf8" });
      const packagesByText = new Map<string, string[]>();
      for (const [name, version] of shippedPackages()) {
        const text = (await read(name)).trim();
        packagesByText.set(text, [...(packagesByText.get(text) ?? []), `${name} ${version}`]);
      }
      const entries = [...packagesByText].map(
        ([text, names]) => `${names.join("\n")}\n\n${text}\n`,
      );
      this.emitFile({ type: "asset", fileName: FILE, source: entries.join(`\n${RULE}\n\n`) });
      const three = bundle["three.js"];
      if (three?.type !== "chunk") this.error("there is no chunk three.js");
      const text = (await read("three")).trim();
      three.code = `/*\nThis file contains three.js.\n\n${text}\n*/\n${three.code}`;
    },
  };
}

/** Return names and versions of the packages that are not only for development. */
function shippedPackages(): [string, string][] {
  return Object.entries<{ name?: string; version?: string; dev?: boolean }>(lock.packages)
    .filter(([path, { dev }]) => path !== "" && !dev)
    .map(([path, { version }]) => [path.replace("node_modules/", ""), version ?? ""]);
}
