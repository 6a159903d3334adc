# What CI runs.
default:
    .ci/run
