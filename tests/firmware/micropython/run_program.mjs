// Run a script in MicroPython's WebAssembly build.
// node run_program.mjs MICROPYTHON.mjs FOLDERS SCRIPT INPUT.json
// FOLDERS, separated by commas, hold the modules. The script reads /input.json and writes
// /output.json, which is printed.
import {readFileSync, readdirSync} from 'node:fs';
import {basename, join} from 'node:path';
import {pathToFileURL} from 'node:url';

const [interpreter, folders, script, input] = process.argv.slice(2);
const {loadMicroPython} = await import(pathToFileURL(interpreter));
const python = await loadMicroPython({
    stdout: (line) => console.error(line),
    linebuffer: true,
});
for (const folder of folders.split(',')) {
    for (const file of readdirSync(folder)) {
        if (file.endsWith('.py')) {
            python.FS.writeFile('/' + basename(file), readFileSync(join(folder, file)));
        }
    }
}
python.FS.writeFile('/input.json', readFileSync(input));
try {
    python.runPython('import sys\nsys.path.insert(0, "/")');
    python.runPython(readFileSync(script, 'utf8'));
} catch (error) {
    console.error(error.message); // node would print the minified interpreter
    process.exit(1);
}
process.stdout.write(python.FS.readFile('/output.json', {encoding: 'utf8'}));
