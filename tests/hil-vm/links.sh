# Arms behind the kernel's own HID and USB drivers. Runs inside scripts/hil-vm; tests/hil-vm/judge.py judges what it leaves in $OUT:
# NAME.arm.json and NAME.host.json (summaries of `hapticd mock` and `hapticd run`), NAME.host.err, NAME.host.code.
#
# What is judged: poses, faults, refusals, that the motors stop. No times: an emulated machine wakes threads late by tens of milliseconds, its USB bus turns
# every 4 ms, and what a processor computes in 25 µs takes 5 ms. Therefore the scene renders at 100 Hz here, with few points and the plane of 2008, which compute
# a tick in 3 ms, and the arms of contact have a watchdog of half a second and so much viscosity that 100 Hz can still push, a tick or two late as well. A host
# that a delay made say `stale` or `overrun`, or begin too late, or whose arm's watchdog bit, is run again, at most $TRIES times; anything else that it says is
# judged at once.
. ./gadget.sh
export NO_COLOR=1
TRIES=12
# The host of an emulated machine takes up to two seconds from its first frame to its first tick, so the hand begins that much later: it presses from 3.7 s
# to 5.5 s after that frame.
awk -F, -v OFS=, 'NR > 1 { $1 += 1.5 } { print }' config/scenes/hands/block-on-plane.csv >config/scenes/hands/links.csv
FAST=config/scenes/links-fast.toml
SCENE=config/scenes/links.toml
sed 's#hands/block-on-plane.csv#hands/links.csv#; s/^field = .*/field = "layers"/; s/^voxel_size_mm = 1.5$/voxel_size_mm = 5\npoints = "voxels"/
  s/box_mm = .20.0, 20.0, 20.0./box_mm = [10, 10, 20]/' config/scenes/block-on-plane.toml >$FAST
sed 's/^rate_hz = 1000$/rate_hz = 100/' $FAST >$SCENE
WRONG_AT=4100ms

# viscous PROFILE: a copy for the emulated machine.
viscous() { sed '/^.plant/,/^$/s/^damping_n_s_per_m = [0-9.]*/damping_n_s_per_m = 15.0/' "devices/$1.toml" >"/tmp/$1.toml"; }

# patient PROFILE: such a copy whose watchdog waits, and whose signs count as checked.
patient() {
  viscous "$1"
  sed -i 's/^signs_verified = false/signs_verified = true/; s/^device_watchdog_ms = 50 /device_watchdog_ms = 500 /' "/tmp/$1.toml"
}

# arm NAME PROFILE ARGS…: an arm, ready for a host.
arm() {
  name="$1" profile="$2"
  shift 2
  # What an earlier attempt said is not to be heard again.
  rm -f "$OUT/$name".*
  hapticd mock "$profile" --json --scene $SCENE --cache /tmp/cache "$@" >"$OUT/$name.arm.json" 2>"$OUT/$name.arm.err" &
  arm_pid=$!
  heard "$OUT/$name.arm.err" "^ready" && sleep 0.3
}

# heard FILE PATTERN [COUNT]: waits until FILE has so many such lines.
heard() {
  for i in $(seq 300); do
    [ -e "$1" ] && [ "$(grep -c "$2" "$1")" -ge "${3:-1}" ] && return 0
    sleep 0.1
  done
  echo "links: no \`$2\` in $1"
  return 1
}

arm_ends() {
  # Whatever the host said last is on its way, or the arm's own watchdog has to bite.
  sleep 0.8
  kill -TERM "$arm_pid" 2>/dev/null
  wait "$arm_pid"
  sleep 0.2
}

# host NAME PROFILE ARGS…: renders the scene on the attached arm; the command does not name its node.
host() {
  name="$1" profile="$2"
  shift 2
  hapticd run $SCENE --device "$profile" --json --cache /tmp/cache --monitor off "$@" >"$OUT/$name.host.json" 2>"$OUT/$name.host.err"
  echo $? >"$OUT/$name.host.code"
}

# late NAME FAULTS: the host said `stale` or `overrun`, or had too long a row of samples overwritten before it read them, or its arm's watchdog bit, where
# FAULTS, as JSON, were expected; or the hand had begun before the host's first tick.
late() {
  gap_ms="$(sed -n 's/.*"longest_gap_ms": *\([0-9]*\).*/\1/p' "$OUT/$1.arm.json")"
  [ "${gap_ms:-0}" -gt 2400 ] && return 0
  grep -qE '"faults": ?\[[^]]*"(stale|overrun|sequence-gap|device-error)"' "$OUT/$1.host.json" && ! grep -qE "\"faults\": ?\[$2\]" "$OUT/$1.host.json"
}

# exchange NAME PROFILE FAULTS LINK [ARM_ARGS] [HOST_ARGS]: an arm and its host, until FAULTS come out or it was not the machine's lateness.
exchange() {
  for try in $(seq $TRIES); do
    arm "$1" "$2" $4 $5
    host "$1" "$2" --enable $6
    arm_ends
    late "$1" "$3" || break
    echo "links: $1: late in attempt $try"
  done
  echo "links: $1 after $(cut -d ' ' -f 1 /proc/uptime) s"
}

for profile in open6-hid open6-serial; do patient $profile; done
for profile in woodenhaptics-v15 polhem-v1 polhem-2019; do viscous $profile; done

# --- HID devices of the kernel's making: /dev/uhid on one side, /dev/hidrawN on the other
exchange hidraw /tmp/open6-hid.toml "" --uhid "" "--duration 9500ms"
exchange woodenhaptics /tmp/woodenhaptics-v15.toml "" --uhid "" "--duration 5500ms"
exchange polhem-mbed /tmp/polhem-v1.toml "" --uhid "" "--duration 5500ms"
exchange polhem-rawhid /tmp/polhem-2019.toml "" --uhid "" "--duration 5500ms"

# Two boards with the same USB numbers: each host refuses the other's reports by their length.
arm not-woodenhaptics polhem-v1 --uhid
host not-woodenhaptics woodenhaptics-v15 --enable --duration 1s
arm_ends
arm not-polhem woodenhaptics-v15 --uhid
host not-polhem polhem-v1 --enable --duration 1s
arm_ends

# An input without motors: the tool goes where the hand goes.
exchange spacemouse spacemouse "" --uhid "" "--duration 5500ms"

# What goes wrong while the arm pushes.
exchange nan /tmp/open6-hid.toml '"non-finite"' --uhid "--fault nan@$WRONG_AT" "--duration 6500ms"
# Eleven garbled replies are `protocol`; at 100 Hz four are `stale` before that.
SCENE=$FAST
exchange garbage /tmp/open6-hid.toml '"protocol"' --uhid "--fault garbage@$WRONG_AT" "--duration 6500ms"
SCENE=config/scenes/links.toml
exchange stall /tmp/open6-hid.toml '"stale"' --uhid "--fault stall@$WRONG_AT" "--duration 6500ms"
exchange unplug /tmp/open6-hid.toml '"disconnected"' --uhid "--fault unplug@$WRONG_AT" "--duration 6500ms"

# The plug comes back, and the operator lets force flow again.
mkfifo /tmp/console
for try in $(seq $TRIES); do
  arm replug /tmp/open6-hid.toml --uhid --fault unplug@$WRONG_AT+700ms
  host replug /tmp/open6-hid.toml --console </tmp/console &
  host_pid=$!
  # Read too: a host that has ended early is no signal that ends this script.
  exec 3<>/tmp/console
  heard "$OUT/replug.host.err" "^preflight" && echo enable >&3
  heard "$OUT/replug.host.err" "^device: back" && sleep 0.3 && echo enable >&3
  heard "$OUT/replug.host.err" "^state: enabled" 2 && sleep 1
  echo stop >&3
  exec 3>&-
  wait $host_pid
  arm_ends
  late replug '"disconnected"' || break
  echo "links: replug: late in attempt $try"
done

# killed NAME PROFILE: the host is killed while it pushes. Its guard has the HID node too, and is in time where the arm's own watchdog waits half a second.
killed() {
  for try in $(seq $TRIES); do
    arm "$1" "$2" --uhid
    hapticd run $SCENE --device "$2" --json --cache /tmp/cache --monitor off --enable >"$OUT/$1.host.json" 2>"$OUT/$1.host.err" &
    host_pid=$!
    heard "$OUT/$1.host.err" "^state: enabled" && sleep 3.2
    kill -KILL $host_pid
    wait $host_pid
    echo $? >"$OUT/$1.host.code"
    arm_ends
    # One that ended by itself was late.
    [ "$(cat "$OUT/$1.host.code")" = 137 ] && ! late "$1" "" && break
    echo "links: $1: late in attempt $try"
  done
}
killed killed-open6 /tmp/open6-hid.toml
killed killed-woodenhaptics /tmp/woodenhaptics-v15.toml
killed killed-polhem-mbed /tmp/polhem-v1.toml
killed killed-polhem-rawhid /tmp/polhem-2019.toml

# --- a USB device, plugged into this machine: a serial port and a HID interface
gadget_up 64 || exit 1
exchange acm /tmp/open6-serial.toml "" "--gadget /dev/ttyGS0" "" "--duration 9500ms"
exchange usb-hid /tmp/open6-hid.toml "" "--gadget /dev/hidg0" "" "--duration 9500ms"

# Its plug is pulled while it pushes.
for try in $(seq $TRIES); do
  arm usb-unplug /tmp/open6-hid.toml --gadget /dev/hidg0
  host usb-unplug /tmp/open6-hid.toml --enable --duration 9500ms &
  host_pid=$!
  heard "$OUT/usb-unplug.host.err" "^state: enabled" && sleep 3.2 && gadget_unplug
  wait $host_pid
  arm_ends
  late usb-unplug '"disconnected"' || break
  echo "links: usb-unplug: late in attempt $try"
  gadget_replug
  sleep 1
done
exit 0
