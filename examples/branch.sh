#!/usr/bin/env bash
# How hard a push would it have stood? Records a walk, and goes on from its fifth second again and again, pushed harder.
#
#     bash examples/branch.sh [FOLDER]
#
# A branch begins in exactly the recorded instant: whatever differs afterwards is the push's doing. docs/recordings.md
# explains it; another --policy, --contract (gains) or --command can be branched to in the same way.
set -euo pipefail
folder=${1:-runs/branch}
mkdir -p "$folder"

play() { python -m humanoid_sim.play --viewer none --video none --overwrite "$@" >"$folder/log.txt"; }

play --robot lite_biped --command 0.3,0,0 --policy-seconds 4 --record "$folder/walk.mcap"
for push in 0.2 0.6 2.5; do
    if play --branch "$folder/walk.mcap@6" --push "0,$push@6.5" --record "$folder/pushed-$push.mcap"; then
        echo "$push m/s to the left: stands"
    else
        echo "$push m/s to the left: falls"
    fi
done
echo "look at one of them: python -m humanoid_sim.play --again $folder/pushed-0.6.mcap --viewer native"
