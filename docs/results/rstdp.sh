#!/usr/bin/env bash
# Makes the runs behind docs/results/rstdp.md: ten seeds of R-STDP in each scenario, with the
# paper's camera (paper), with the best camera setting found (best) and, in scenario 3, with the
# paper's camera and a larger reward (reward), then laps with learning off.
# Usage: docs/results/rstdp.sh OUT [JOBS]; about 45 minutes on 2 free cores. What is there is kept.
# The table: docs/results/rstdp_table.py OUT.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd -P)
out=$(mkdir -p "$1" && cd "$1" && pwd -P)
jobs=${2:-2}
export root out

spikelane() { # FILE ARGUMENTS...: writes the command's JSON to a file, once it has ended
  local file=$1
  shift
  [ -e "$file" ] && return
  rm -rf "${@: -1}" # what an interrupted run left
  "$root/spikelane" "$@" 2>"$file.log" >"$file.part" || true
  [ ! -s "$file.part" ] || mv "$file.part" "$file"
}

measure() { # SETTING SCENARIO STEPS SEED
  local run=$out/$1/$2/$4 options=() lane
  mkdir -p "$out/$1/$2"
  case $1 in
  best) options=(--antialias --param simulator.pixels.coppelia.threshold=0.3
    --param rstdp.poisson.max_events=30) ;;
  reward) options=(--param rstdp.c_r=0.03) ;;
  esac
  spikelane "$run.train.json" train rstdp --scenario "$2" --steps "$3" --seed "$4" \
    --transport inprocess --json "${options[@]}" --out "$run"
  for lane in outer inner; do # three laps in a row, learning off
    spikelane "$run.$lane.json" lap --controller rstdp --checkpoint "$run" --scenario "$2" \
      --lane "$lane" --seed "$((100 + $4))" --transport inprocess --json \
      --param simulator.episode.max_laps=3 "${options[@]}" --out "$run-$lane"
  done
}
export -f spikelane measure

for job in 'best 1 30000' 'best 2 30000' 'best 3 30000' \
  'paper 1 30000' 'paper 2 40000' 'reward 3 30000' 'paper 3 120000'; do
  for seed in {0..9}; do echo "$job $seed"; done
done | xargs -P "$jobs" -L 1 bash -c 'measure $0 $1 $2 $3'
