#!/bin/bash
# Runs inside a booted Debian: what the unit's own words and the manual say, as it stands.
# /src has deploy/, docs/, clouds/ and target/release/lodestone; /out takes what is told.
exec >/out/log 2>&1
cd /src
wrong=0
# The n-th block of commands of a chapter of the manual.
block() {
  awk -v title="## $1" -v n="$2" '$0 == title { on = 1; next } /^## / { on = 0 }
    on && /^```sh$/ { if (++k == n) inside = 1; next } /^```$/ { inside = 0 } inside' docs/manual.md
}
run() {
  printf '== %s\n%s\n' "$1" "$2"
  [[ -n $2 ]] && bash -e -c "$2" || { echo "WRONG: $1"; wrong=$((wrong + 1)); }
}
await() { # what it is, command
  for _ in $(seq 1200); do
    if eval "$2"; then echo "-- $1"; return; fi
    sleep 0.5
  done
  echo "WRONG: no $1"
  wrong=$((wrong + 1))
  journalctl -u lodestone -n 30 --no-pager
}
alive() { await "alive" 'curl -sf http://127.0.0.1:7700/healthz >/dev/null'; }
done_jobs() { lodestone jobs --root "$1" list | awk '$3 == "done"' | wc -l; }
export -f done_jobs
drop() { runuser -u ada -- cp "clouds/$1.las" "$2/inbox/" || { echo "WRONG: $1 not dropped"; wrong=$((wrong + 1)); }; }

useradd -m ada
mkdir -p /backup /run/systemd/system/lodestone.service.d
# Pictures are seen to be made, and need not be many.
printf '[Service]\nEnvironment=LODESTONE_PREVIEW_FRAMES=3\n' >/run/systemd/system/lodestone.service.d/frames.conf
root=/var/lib/lodestone
run "installed" "$(sed -n 's/^#   \(install\|systemd-sysusers\)/\1/p' deploy/lodestone.service)"
run "a member of the group" "$(sed -n 's/^#   usermod/usermod/p' deploy/lodestone.service)"
alive
for name in a b c d e; do drop $name $root; done
await "five octrees with all pictures" "[[ \$(ls $root/octrees/[a-e]/preview/turntable.webp 2>/dev/null | wc -l) == 5 ]]"
run "no restart" "[[ \$(systemctl show lodestone -p NRestarts --value) == 0 ]]"
run "octrees are read and jobs told by the group" "runuser -u ada -- cat $root/octrees/a/metadata.json >/dev/null
[[ \$(runuser -u ada -- lodestone jobs --root $root list | grep -c done) == 5 ]]"

run "backed up" "$(block 'Backing up' 1)"
run "upgraded" "$(block Upgrading 1)"
alive
drop f $root
await "another" "[[ -e $root/octrees/f/metadata.json ]]"
run "restored" "$(block 'Backing up' 2)"
alive
# What the copy does not know lies in the inbox still, and is made again.
await "six jobs" "[[ \$(done_jobs $root) == 6 ]]"
rm -r $root/octrees/a
id=$(lodestone jobs --root $root list | awk '$2 == "a" { print $1; exit }')
run "made anew" "lodestone jobs --root $root retry $id"
await "its octree" "[[ -e $root/octrees/a/metadata.json ]]"

run "moved" "$(block Moving 1)"
alive
root=/srv/lodestone
drop g $root
await "one more" "[[ -e $root/octrees/g/metadata.json ]]"
run "nothing was converted twice" "[[ \$(done_jobs $root) == 7 ]]"
run "no restart" "[[ \$(systemctl show lodestone -p NRestarts --value) == 0 ]]"

run "uninstalled" "$(block Uninstalling 1)"
run "nothing runs, the data is there" "! systemctl is-active lodestone && ! systemctl cat lodestone && [[ -e $root/octrees/a ]]"
run "nor is the user" "userdel lodestone"
echo "$wrong wrong"
systemctl poweroff
