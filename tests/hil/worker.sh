#!/bin/sh
# Starts a worker in the environment of its bench. Called by a symbolic link that stands beside `environment`: nothing that is executed is written meanwhile.
. "${0%/*}/environment"
# It keeps time as far as that is allowed.
first="chrt -f $PRIORITY"
$first true 2>/dev/null || first=
exec $first "$HAPTICD" "$@"
