#!/bin/sh
# The brokers that other transports need, where they may be installed: root on a machine with apt-get. Elsewhere those transports
# are left out of the comparison, which says so; this never fails.
have() { PATH="$PATH:/usr/sbin:/usr/local/sbin" command -v "$1" >/dev/null; }
if have mosquitto && have nats-server; then exit 0; fi
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "mosquitto or nats-server is missing and cannot be installed here (Debian: mosquitto, nats-server)"
    exit 0
fi
echo "installing mosquitto and nats-server for the comparison of transports (once) ..."
export DEBIAN_FRONTEND=noninteractive
# Their services are not wanted: each run starts brokers of its own.
if apt-get update -qq >/dev/null 2>&1 &&
    RUNLEVEL=1 apt-get install -y -qq --no-install-recommends mosquitto nats-server >/dev/null 2>&1; then
    exit 0
fi
echo "mosquitto and nats-server could not be installed"
