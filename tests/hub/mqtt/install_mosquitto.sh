#!/bin/sh
# The broker that the tests speak to, its shell clients and jq, where they may be installed: root on a machine with apt-get.
# Elsewhere the tests that need them are skipped and say why; this never fails.
if PATH="$PATH:/usr/sbin" command -v mosquitto >/dev/null && command -v mosquitto_sub >/dev/null && command -v jq >/dev/null; then exit 0; fi
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "mosquitto is missing and cannot be installed here: tests with a broker are skipped (Debian: mosquitto, mosquitto-clients, jq)"
    exit 0
fi
echo "installing mosquitto for the tests with a broker (once) ..."
export DEBIAN_FRONTEND=noninteractive
# Its service is not wanted: each test starts a broker of its own.
if apt-get update -qq >/dev/null 2>&1 &&
    RUNLEVEL=1 apt-get install -y -qq --no-install-recommends mosquitto mosquitto-clients jq >/dev/null 2>&1; then
    exit 0
fi
echo "mosquitto could not be installed: tests with a broker are skipped"
