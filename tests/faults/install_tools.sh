#!/bin/sh
# What the fault suite needs of the system, where it may be installed: root on a machine with apt-get. Elsewhere the tests
# that need it are skipped and say why; this never fails.
if command -v ip >/dev/null && command -v nft >/dev/null; then exit 0; fi
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "ip or nft is missing and cannot be installed here: tests on two hosts are skipped (Debian: iproute2, nftables)"
    exit 0
fi
echo "installing iproute2 and nftables for the tests on two hosts (once) ..."
export DEBIAN_FRONTEND=noninteractive
if apt-get update -qq >/dev/null 2>&1 && apt-get install -y -qq --no-install-recommends iproute2 nftables >/dev/null 2>&1; then
    exit 0
fi
echo "iproute2 and nftables could not be installed: tests on two hosts are skipped"
