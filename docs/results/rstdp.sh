#!/usr/bin/env bash
# Makes the figures of docs/results/rstdp.md: ten seeds of R-STDP in each scenario, with the
# paper's camera and with the best setting found, then laps with learning off.
# Usage: docs/results/rstdp.sh OUT [JOBS]; about 40 minutes on 2 cores. What is there is kept.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd -P)
out=$(mkdir -p "$1" && cd "$1" && pwd -P)
jobs=${2:-2}
export root out

train() { # SETTING SCENARIO STEPS SEED
  local run=$out/$1/$2/$4 options=()
  [ "$1" = paper ] || options=(--antialias --param simulator.pixels.coppelia.threshold=0.3
    --param rstdp.poisson.max_events=30)
  [ -e "$run.train.json" ] || { "$root/spikelane" train rstdp --scenario "$2" --steps "$3" \
    --seed "$4" --transport inprocess --out "$run" --json "${options[@]}" 2>"$run.log" \
    >"$run.part" && mv "$run.part" "$run.train.json"; }
  local lane
  for lane in outer inner; do # three laps in a row, learning off
    [ -e "$run.$lane.json" ] || { "$root/spikelane" lap --controller rstdp --checkpoint "$run" \
      --scenario "$2" --lane "$lane" --seed "$((100 + $4))" --transport inprocess \
      --param simulator.episode.max_laps=3 --out "$run-$lane" --json "${options[@]}" \
      2>>"$run.log" >"$run.part" || true; mv "$run.part" "$run.$lane.json"; }
  done
}
export -f train

for setting in paper best; do
  for scenario in 1 2 3; do mkdir -p "$out/$setting/$scenario"; done
done
{
  for seed in {0..9}; do
    echo "paper 1 30000 $seed"; echo "paper 2 40000 $seed"; echo "paper 3 120000 $seed"
    echo "best 1 10000 $seed"; echo "best 2 10000 $seed"; echo "best 3 30000 $seed"
  done
} | xargs -P "$jobs" -L 1 bash -c 'train $0 $1 $2 $3'
