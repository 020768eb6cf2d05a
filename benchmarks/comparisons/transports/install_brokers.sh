#!/bin/sh
# Installs the brokers of other transports, as root on a machine with apt-get. Elsewhere the comparison leaves those
# transports out and says so; this script never fails.
have() { PATH="$PATH:/usr/sbin:/usr/local/sbin" command -v "$1" >/dev/null; }
if have mosquitto && have nats-server; then exit 0; fi
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "mosquitto or nats-server is missing and cannot be installed here (Debian: mosquitto, nats-server)"
    exit 0
fi
echo "installing mosquitto and nats-server for the comparison of transports (once) ..."
export DEBIAN_FRONTEND=noninteractive
# Their services are not started: each run starts its own brokers.
if apt-get update -qq >/dev/null 2>&1 &&
    RUNLEVEL=1 apt-get install -y -qq --no-install-recommends mosquitto nats-server >/dev/null 2>&1; then
    exit 0
fi
echo "mosquitto and nats-server could not be installed"
