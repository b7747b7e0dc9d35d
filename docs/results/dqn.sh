#!/usr/bin/env bash
# Trains the deep Q-network in each scenario with five seeds, the paper's parameters and the
# pybullet robot, then drives a greedy lap of each lane.
# Usage: docs/results/dqn.sh OUT [JOBS]; about 15 minutes of a core for each of the 15 trainings.
# What is there is kept; a training that was stopped goes on.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd -P)
out=$(mkdir -p "$1" && cd "$1" && pwd -P)
jobs=${2:-2}
export root out

train() { # SCENARIO STEPS SEED
  local run=$out/$1/$3 options=()
  [ -e "$run/checkpoint.safetensors" ] && options=(--resume)
  [ -e "$run.train.json" ] || { "$root/spikelane" train dqn --scenario "$1" --steps "$2" \
    --seed "$3" --transport inprocess --out "$run" --json "${options[@]}" 2>"$run.log" \
    >"$run.part" && mv "$run.part" "$run.train.json"; }
  local lane
  for lane in outer inner; do
    [ -e "$run.$lane.json" ] || { rm -rf "$run-$lane"
      "$root/spikelane" lap --controller dqn --checkpoint "$run" \
      --scenario "$1" --lane "$lane" --seed "$((100 + $3))" --transport inprocess \
      --out "$run-$lane" --json 2>>"$run.log" >"$run.part" || true
      mv "$run.part" "$run.$lane.json"; }
  done
}
export -f train

for scenario in 1 2 3; do mkdir -p "$out/$scenario"; done
{
  for seed in {0..4}; do
    echo "1 100000 $seed"; echo "2 100000 $seed"; echo "3 150000 $seed"
  done
} | xargs -P "$jobs" -L 1 bash -c 'train $0 $1 $2'
