#!/bin/sh
# Fills subprojects/libgpiod2/ with the C sources of libgpiod 2 that the Python package gpiod carries (lib/ and include/,
# unchanged), so that the back end for libgpiod 2 is tested where the system has libgpiod 1. Needs pip.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
target=$here/subprojects/libgpiod2
if [ -f "$target/meson.build" ]; then
    exit 0
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM
python3 -m pip download --quiet --disable-pip-version-check --no-deps --no-binary :all: --dest "$work" 'gpiod>=2.1,<3'
mkdir "$work/unpacked"
tar -xzf "$work"/gpiod-*.tar.gz -C "$work/unpacked" --strip-components=1
version=$(cat "$work/unpacked/libgpiod-version.txt")
rm -rf "$target.new"
mkdir -p "$target.new"
cp -r "$work/unpacked/lib" "$work/unpacked/include" "$work/unpacked/LICENSE" "$target.new/"
cat >"$target.new/meson.build" <<END
project('libgpiod', 'c', version: '$version', license: 'LGPL-2.1-or-later', default_options: ['c_std=gnu11'])
libgpiod2 = static_library('gpiod2', run_command('sh', '-c', 'ls lib/*.c', check: true).stdout().strip().split('\n'),
  c_args: ['-D_GNU_SOURCE', '-DGPIOD_VERSION_STR="$version"', '-DGPIOD_API_VERSION_STR="$version"'], include_directories: include_directories('include', 'lib'))
libgpiod2_dep = declare_dependency(link_with: libgpiod2, include_directories: include_directories('include'))
END
rm -rf "$target"
mv "$target.new" "$target"
