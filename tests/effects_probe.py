"""What both effects_cost.py share: a program that is built once more with an effect compiled out, instructions counted by
callgrind, and lines as Unity prints them."""
import os
import re
import shlex
import shutil
import subprocess

TOLERANCE = 0.0005


def write(folder, name, text):
    path = os.path.join(folder, name)
    with open(path, 'w', encoding='utf-8') as file:
        file.write(text)
    return path


class Probe:
    """The program `target` of a build, and what was found of it so far."""

    def __init__(self, build, target, asking, macro, toggle):
        self.build, self.target = build, target
        self.asking = asking  # sources that ask whether an effect is there
        self.macro = macro  # that names the effect which is compiled out
        self.toggle = toggle  # the function in which instructions count
        self.ours = os.path.join(build, target)
        self.tests = self.failures = 0

    def report(self, name, problem):
        """One line as Unity prints it."""
        self.tests += 1
        self.failures += bool(problem)
        print(f'effects_cost.py:1:{name}:' + (f'FAIL: {problem}' if problem else 'PASS'), flush=True)

    def run(self, command, **more):
        return subprocess.run(command, cwd=self.build, check=True, capture_output=True, text=True, **more).stdout

    def check_built(self):
        stale = 'no work to do' not in self.run(['ninja', '-n', self.target])
        self.report('the_usual_program_is_built_from_the_sources', stale and f'build {self.target} first')

    def build_without(self, effect, folder):
        """The program with an effect compiled out: by the build's own commands, into another folder."""
        commands = [shlex.split(c) for c in self.run(['ninja', '-t', 'commands', self.target]).splitlines()]
        objects = []
        for source in self.asking:
            command = next(c for c in commands if '-c' in c and c[c.index('-c') + 1].endswith(source))
            made = os.path.join(folder, os.path.basename(source) + '.o')
            command[command.index('-o') + 1] = made
            command[command.index('-MF') + 1] = made + '.d'
            self.run(command + [f'-D{self.macro}={effect}'])
            objects.append(made)
        link = next(c for c in commands if '-o' in c and c[c.index('-o') + 1] == self.target and '-c' not in c)
        at = link.index('-o')
        program = os.path.join(folder, 'probe')
        self.run(link[:at] + ['-o', program] + objects + link[at + 2:])
        return program

    def measure(self, command, env):
        """What the program prints, as a dictionary."""
        return dict(line.split(': ') for line in self.run(command, env=env).splitlines())

    def count_instructions(self, command, env, folder):
        """Instructions in the function, by callgrind."""
        out = os.path.join(folder, 'callgrind.out')
        self.run(['valgrind', '--tool=callgrind', '--collect-atstart=no', f'--toggle-collect={self.toggle}',
                  f'--callgrind-out-file={out}', *command], env=env)
        with open(out, encoding='utf-8') as file:
            return int(re.search(r'^(?:summary|totals): (\d+)', file.read(), re.M).group(1))

    def compare_instructions(self, name, here, there, env, folder):
        """Of two commands, where they can be counted."""
        if shutil.which('valgrind'):
            counts = [self.count_instructions(command, env, folder) for command in (here, there)]
            off = counts[0] / counts[1] - 1
            print(f'{name}: {counts[0]} instructions, {counts[1]} without it in the program: {100 * off:+.4f} %')
            self.report(f'{name}_costs_no_instructions', (counts[1] < 1000000 or abs(off) > TOLERANCE) and counts)

    def end(self):
        """Totals as Unity prints them; the exit status."""
        if not shutil.which('valgrind'):
            print('valgrind is not installed: instructions were not counted')
        print(f'{self.tests} Tests {self.failures} Failures 0 Ignored')
        return 1 if self.failures else 0
