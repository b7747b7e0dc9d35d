#!/usr/bin/env bash
# Transfers trained Q-networks to spiking networks, with the paper's settings and with the best
# found, and drives laps with each: accuracy and errors of the DQN-SNN beside those of its DQN.
# Usage: docs/results/dqn_snn.sh OUT DQN [JOBS]; DQN/SCENARIO/SEED are folders of trainings
# (`spikelane train dqn`). What is there is kept.
set -euo pipefail
root=$(cd "$(dirname "$0")/../.." && pwd -P)
out=$(mkdir -p "$1" && cd "$1" && pwd -P)
dqn=$(cd "$2" && pwd -P)
jobs=${3:-2}
export root out dqn

lap() { # RUN LANE CONTROLLER CHECKPOINT SCENARIO SEED [OPTION...]
  [ -e "$1.$2.json" ] || { "$root/spikelane" lap --controller "$3" --checkpoint "$4" \
    --scenario "$5" --lane "$2" --seed "$((100 + $6))" --transport inprocess \
    --out "$1-$2" --json "${@:7}" 2>>"$1.log" >"$1.$2.part" || true; mv "$1.$2.part" "$1.$2.json"; }
}

transfer() { # SETTING SCENARIO SEED
  local run=$out/$1/$2/$3 options=() driving=() lane
  [ "$1" = paper ] || options=(--steps 40000 --param transfer.batch_size=100
    --param transfer.learning_rate=1e-3 --param transfer.decays=true
    --param transfer.input_gain=8.0 --param transfer.normalisation=data)
  [ "$1" = paper ] || driving=(--param dqn_snn.encoding.frames=10)
  [ -e "$run.transfer.json" ] || { rm -rf "$run"; "$root/spikelane" transfer --scenario "$2" \
    --checkpoint "$dqn/$2/$3" --seed "$3" --out "$run" --json "${options[@]}" 2>"$run.log" \
    >"$run.part" && mv "$run.part" "$run.transfer.json"; }
  for lane in outer inner; do
    lap "$run" "$lane" dqn_snn "$run" "$2" "$3" "${driving[@]}"
    [ "$1" != paper ] || lap "$run.dqn" "$lane" dqn "$dqn/$2/$3" "$2" "$3"
  done
}
export -f lap transfer

for setting in paper best; do
  for scenario in 1 2 3; do mkdir -p "$out/$setting/$scenario"; done
done
for setting in paper best; do
  for scenario in 1 2 3; do
    for run in "$dqn/$scenario"/*/checkpoint.safetensors; do
      [ ! -e "$run" ] || echo "$setting $scenario $(basename "$(dirname "$run")")"
    done
  done
done | xargs -r -P "$jobs" -L 1 bash -c 'transfer $0 $1 $2'
