#!/bin/sh
# A Home Assistant in the environment $1, and Node-RED beside it where there is npm (elsewhere its test is skipped): minutes.
# Home Assistant 2024.3.3 is the last that runs on Python 3.11; newer ones of josepy are not for it.
set -e
"${PYTHON:-python3}" -m venv "$1"
"$1/bin/python" -m pip install --quiet --disable-pip-version-check "homeassistant==2024.3.3" "josepy<2" "paho-mqtt==1.6.1"
if command -v npm >/dev/null; then
    npm install --silent --no-audit --no-fund --prefix "$1/node-red" node-red@3.1.15 >/dev/null 2>&1 ||
        echo "Node-RED could not be installed: its test is skipped"
fi
