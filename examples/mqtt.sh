#!/bin/sh
# Does something when a movement was judged: examples/mqtt.sh [HOST [PORT]], the broker of `labanmesh hub mqtt`.
# Needs mosquitto_sub and jq (Debian: mosquitto-clients, jq).
mosquitto_sub -h "${1:-127.0.0.1}" -p "${2:-1883}" -t 'labanmesh/+/verdict' |
    jq --unbuffered -r 'select(.stage == "decided") | "\(.event_type) \(.confidence) \(.agreement)"' |
    while read -r movement confidence agreement; do
        case $movement in
        abstain) echo "something was done, and the judges could not agree what" ;;
        # Here: call what your movements shall do, e.g. curl http://lamp.local/toggle
        *) echo "$movement, $confidence % sure, $agreement judges" ;;
        esac
    done
