#!/bin/sh
# What tests/browser needs: axe-core from npm, in the environment of this run, and Chromium where it may be installed, as
# root on a machine with apt-get. Elsewhere those tests are skipped and say why; this never fails.
if [ -n "$1" ] && [ ! -d "$1/axe/node_modules/axe-core" ]; then
    npm install --silent --no-save --no-package-lock --prefix "$1/axe" axe-core@4.10.3 >/dev/null 2>&1 ||
        echo "axe-core could not be fetched (npm): the tests of accessibility are skipped"
fi
if command -v chromium >/dev/null; then exit 0; fi
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "chromium is missing and cannot be installed here: tests in a browser are skipped (Debian: chromium)"
    exit 0
fi
echo "installing chromium for the tests in a browser (once) ..."
export DEBIAN_FRONTEND=noninteractive
if apt-get update -qq >/dev/null 2>&1 && apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core >/dev/null 2>&1; then
    exit 0
fi
echo "chromium could not be installed: tests in a browser are skipped"
