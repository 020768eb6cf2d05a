#!/usr/bin/env bash
# Acts when a movement is decided: examples/mqtt.sh [HOST [PORT]], the broker of `labanmesh hub mqtt`.
# Needs mosquitto_sub and jq (Debian: mosquitto-clients, jq).
case ${1:-} in -*) echo "usage: examples/mqtt.sh [HOST [PORT]], e.g. examples/mqtt.sh 127.0.0.1 1883" >&2 && exit 2 ;; esac
{ command -v mosquitto_sub && command -v jq; } >/dev/null || { echo "mqtt.sh: install mosquitto-clients and jq" >&2 && exit 1; }
echo "mqtt.sh: waits for verdicts from the broker ${1:-127.0.0.1}:${2:-1883}; another: examples/mqtt.sh HOST PORT" >&2
# The script becomes mosquitto_sub: what ends one ends both, and the loop reads the end of its input.
exec mosquitto_sub -h "${1:-127.0.0.1}" -p "${2:-1883}" -t 'labanmesh/+/verdict' > >(
    jq --unbuffered -r 'select(.stage == "decided") | "\(.event_type) \(.confidence) \(.agreement)"' |
        while read -r movement confidence agreement; do
            case $movement in
            abstain) echo "there was a movement, and the observers did not agree which" ;;
            # Replace this with your own action, e.g. curl http://lamp.local/toggle
            *) echo "$movement, $confidence % sure, $agreement observers" ;;
            esac
        done
)
