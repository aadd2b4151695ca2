#!/bin/sh
# Fills subprojects/unity-debian/ with the Unity test framework that Debian's source package zeromq3 carries
# (external/unity, unchanged 2.4.3), for machines that reach a Debian mirror but not GitHub.
# Needs dpkg-dev. The machine's own apt configuration is read, not changed.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
target=$here/subprojects/unity-debian
if [ -f "$target/meson.build" ]; then
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM
# apt's unprivileged fetcher writes here.
chmod 755 "$work"
mkdir -p "$work/parts" "$work/lists/partial" "$work/cache/archives/partial" "$work/source" "$work/unpacked"

# The machine's own binary sources, of Debian only, turned into source ones.
for list in /etc/apt/sources.list /etc/apt/sources.list.d/*.list; do
    if [ -f "$list" ]; then
        sed -n '/debian/s/^deb /deb-src /p' "$list" >>"$work/parts/debian.list"
    fi
done
count=0
for list in /etc/apt/sources.list.d/*.sources; do
    if [ -f "$list" ] && grep -q '^URIs:.*debian' "$list"; then
        count=$((count + 1))
        sed 's/^Types:.*/Types: deb-src/' "$list" >"$work/parts/debian$count.sources"
    fi
done

apt_here() {
    "$@" -o Dir::Etc::SourceList=/dev/null -o Dir::Etc::SourceParts="$work/parts" \
        -o Dir::State::Lists="$work/lists" -o Dir::Cache="$work/cache" -o APT::Sandbox::User= -qq
}
apt_here apt-get update
cd "$work/source"
apt_here apt-get source --download-only zeromq3
tar -xf zeromq3_*.orig.tar.* -C "$work/unpacked" --strip-components=1

mkdir -p "$target.new"
cp "$work"/unpacked/external/unity/unity.c "$work"/unpacked/external/unity/*.h \
    "$work"/unpacked/external/unity/license.txt "$target.new/"
cat >"$target.new/meson.build" <<'END'
project('unity', 'c', version: '2.4.3', license: 'MIT')
unity_dep = declare_dependency(
  link_with: static_library('unity', 'unity.c', c_args: '-DUNITY_INCLUDE_DOUBLE'),
  include_directories: include_directories('.'))
END
rm -rf "$target"
mv "$target.new" "$target"
