#!/bin/bash
# Runs both commands of the README in an empty Debian root, as root and as an ordinary user with sudo, and times them.
# Not part of the default tests: needs root, debootstrap and a package mirror (the one this machine's apt uses).
set -eu -o pipefail

usage() {
  echo "usage: fresh_root.sh [--as root|user|both] [--only demo|test|both] [--keep] [DIR]"
  echo "Debootstraps an empty Debian under DIR (default /var/tmp/tendril-fresh), clones this checkout's last commit into"
  echo "it, and runs tools/demo twice and tools/test there. The folder is removed at the end unless --keep is given."
}
who="root user" what="demo test" keep=no dir=/var/tmp/tendril-fresh
while [ $# -gt 0 ]; do
  case $1 in
    --help | -h) usage; exit 0 ;;
    --as) case ${2:-} in root | user) who=$2 ;; both) ;; *) usage >&2; exit 2 ;; esac; shift ;;
    --only) case ${2:-} in demo | test) what=$2 ;; both) ;; *) usage >&2; exit 2 ;; esac; shift ;;
    --keep) keep=yes ;;
    -*) usage >&2; exit 2 ;;
    *) dir=$1 ;;
  esac
  shift
done
[ "$(id -u)" = 0 ] || { echo "fresh_root.sh: needs root (debootstrap, chroot)" >&2; exit 1; }
command -v debootstrap >/dev/null || { echo "fresh_root.sh: needs debootstrap: apt-get install debootstrap" >&2; exit 1; }

# Everything below lives in namespaces of its own: mounts and processes are gone when the script ends.
if [ -z "${TENDRIL_FRESH_ROOT:-}" ]; then
  arguments=("$dir")
  [ "$who" = "root user" ] || arguments=(--as "$who" "${arguments[@]}")
  [ "$what" = "demo test" ] || arguments=(--only "$what" "${arguments[@]}")
  [ $keep = no ] || arguments=(--keep "${arguments[@]}")
  TENDRIL_FRESH_ROOT=1 exec unshare --mount --pid --fork --kill-child --mount-proc "$0" "${arguments[@]}"
fi
checkout=$(cd "$(dirname "$(readlink -f "$0")")/../.." && pwd)

suite=$(. /etc/os-release && echo "$VERSION_CODENAME")
mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' "Release: $suite" 'Component: main' | head -n 1)
[ -n "$mirror" ] || { echo "fresh_root.sh: apt has no source for '$suite' on this machine" >&2; exit 1; }

mkdir -p "$dir"
cleanup() { [ $keep = yes ] || rm -rf --one-file-system "$dir"; }
trap cleanup EXIT
rm -rf --one-file-system "$dir/base"
echo "== debootstrap $suite from $mirror"
debootstrap --variant=minbase "$suite" "$dir/base" "$mirror" >"$dir/debootstrap.log" ||
  { tail -n 5 "$dir/debootstrap.log" >&2; exit 1; }
# This machine's way to its packages (sources, proxies, certificates, keys), whatever it is.
# The certificates under a name of their own: the ones of a package would take their place.
bundle=/etc/ssl/certs/ca-certificates.crt
[ ! -f $bundle ] || install -D -m 644 $bundle "$dir/base/etc/ssl/fresh-root.crt"
[ ! -f /etc/pip.conf ] || cp -L /etc/pip.conf "$dir/base/etc/"
rm -rf "$dir/base/etc/apt"
cp -a /etc/apt "$dir/base/etc/apt"
cp -a /usr/share/keyrings/. "$dir/base/usr/share/keyrings/"
cp -L /etc/resolv.conf /etc/hosts "$dir/base/etc/"
rm -rf "$dir"/base/var/lib/apt/lists/*

status=0
report=()
for person in $who; do
  target=$dir/$person
  rm -rf --one-file-system "$target"
  cp -a "$dir/base" "$target"
  mount -t proc proc "$target/proc"
  mount -t tmpfs -o mode=1777 tmp "$target/tmp"
  mount --rbind /dev "$target/dev"
  mount --make-rslave "$target/dev"
  mount -t tmpfs -o mode=1777 shm "$target/dev/shm"
  clean=(env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin TERM=dumb)
  for name in http_proxy https_proxy no_proxy PIP_INDEX_URL; do
    [ -z "${!name:-}" ] || clean+=("$name=${!name}")
  done
  [ ! -f "$dir/base/etc/ssl/fresh-root.crt" ] || clean+=(PIP_CERT=/etc/ssl/fresh-root.crt)
  if [ "$person" = user ]; then
    chroot "$target" "${clean[@]}" DEBIAN_FRONTEND=noninteractive sh -c \
      'apt-get -qq update && apt-get -qq install -y --no-install-recommends sudo >/dev/null'
    chroot "$target" useradd --create-home --shell /bin/bash someone
    echo 'someone ALL=(ALL) NOPASSWD: ALL' >"$target/etc/sudoers.d/someone"
    home=/home/someone
    run=(chroot "$target" setpriv --reuid=someone --regid=someone --init-groups -- "${clean[@]}" HOME=$home USER=someone)
  else
    home=/root
    run=(chroot "$target" "${clean[@]}" HOME=$home USER=root)
  fi
  git -c safe.directory="$checkout/.git" -c safe.directory="$checkout" clone --quiet --no-hardlinks "$checkout" "$target$home/tendril"
  [ "$person" = root ] || chroot "$target" chown -R someone: "$home/tendril"

  for step in $what; do
    repeats=1
    [ "$step" = demo ] && repeats=2
    for ((i = 1; i <= repeats; ++i)); do
      log=$dir/$person-$step-$i.log
      began=$SECONDS
      code=0
      (cd / && "${run[@]}" "$home/tendril/tools/$step" </dev/null) >"$log" 2>&1 || code=$?
      report+=("$(printf '%-5s tools/%-5s call %d: exit %d, %4d s' "$person" "$step" "$i" "$code" $((SECONDS - began)))")
      echo "== ${report[-1]}"
      tail -n 12 "$log" | sed 's/^/   | /'
      [ $code = 0 ] || status=1
    done
  done
  foreign=$(find "$target$home/tendril" ! -uid "$(stat -c %u "$target$home/tendril")" | head -n 3)
  [ -z "$foreign" ] || { echo "== files of a foreign owner in the checkout: $foreign"; status=1; }
  umount -R "$target/dev" "$target/tmp" "$target/proc" 2>/dev/null || umount -lR "$target/dev" "$target/tmp" "$target/proc"
  [ $keep = yes ] || rm -rf --one-file-system "$target"
done
echo "== summary"
printf '%s\n' "${report[@]}"
exit $status
