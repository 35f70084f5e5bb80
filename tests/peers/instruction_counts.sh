#!/bin/sh
# Counts the instructions of one call of each main row, and compares with kernel/dynamics/benches/instruction_counts.txt.
#
#   tests/peers/instruction_counts.sh            compare; fails where a row grew by more than 3 %
#   tests/peers/instruction_counts.sh --write    write the file anew
#
# Counts do not depend on the load of the machine, but on the compiler and the C library: write the file anew, in a commit of its own,
# when either changes. Runs only where valgrind is.
set -eu
cd "$(dirname "$0")/../.."
if ! command -v valgrind >/dev/null; then
    echo "valgrind is not installed: no instructions counted"
    exit 0
fi
kept=kernel/dynamics/benches/instruction_counts.txt
now=$(mktemp)
trap 'rm -f "$now"' EXIT
programs=$(cargo bench -p sagci-dynamics -p sagci-planning --benches --no-run --message-format=json |
    sed -n 's/.*"kind":\["bench"\].*"executable":"\([^"]*\)".*/\1/p')
# Bench, and the whole name of a row.
while IFS='|' read -r bench row; do
    program=$(echo "$programs" | grep "/$bench-[0-9a-f]*$")
    said=$(valgrind --tool=callgrind --callgrind-out-file=/dev/null --collect-atstart=no --toggle-collect='*common::counted*' \
        "$program" --once --row "$row" 2>&1)
    calls=$(echo "$said" | sed -n "s/^\([0-9]*\) calls: .*/\1/p")
    total=$(echo "$said" | sed -n 's/.*Collected : \([0-9]*\).*/\1/p')
    printf '%12d  %s\n' "$((total / calls))" "$row" >>"$now"
done <<'ROWS'
speed|forward dynamics
speed|its derivatives by q, v, tau
speed|free step
speed|free step + A, B
gripping|gripping step, 8 contacts
gripping|gripping step + A, B
gripping|the same + every parameter
rollouts|1,000 free steps + gradient
rollouts|300 gripping steps + gradient
reach|DDP, 7-dof reach, 100 knots, whole solve
ROWS
if [ "${1:-}" = --write ]; then
    cp "$now" "$kept"
    cat "$kept"
    exit 0
fi
awk '
    { count = $1; $1 = ""; name = substr($0, 2) }
    FNR == NR { was[name] = count; next }
    !(name in was) { printf "new    %12d  %s\n", count, name; next }
    {
        change = 100 * (count / was[name] - 1)
        grew = change > 3
        bad += grew
        printf "%+6.1f %% %12d  %s%s\n", change, count, name, grew ? "   GREW" : ""
    }
    END { exit bad > 0 }
' "$kept" "$now"
