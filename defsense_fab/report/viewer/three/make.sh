#!/bin/sh
# Makes three.min.js anew: of three.js what entry.js names, as one classic script that sets THREE
# (modules are not loaded from file://). Needs npm and the npm registry; raise THREE and run it to
# take another version, then run the tests of the view in a browser.
set -eu
THREE=0.187.0
ESBUILD=0.28.2
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
npm init --yes > /dev/null
npm install --ignore-scripts --save-exact "three@$THREE" "esbuild@$ESBUILD"
node node_modules/esbuild/install.js
cp "$here/entry.js" entry.js
node_modules/.bin/esbuild entry.js --bundle --minify --format=iife --global-name=THREE \
    --target=es2022 --legal-comments=none --charset=ascii \
    --banner:js="/* three.js $THREE, MIT licence, (c) 2010-2026 three.js authors: see LICENSE beside this file */" \
    --outfile="$here/three.min.js"
cp node_modules/three/LICENSE "$here/LICENSE"
