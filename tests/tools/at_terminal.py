"""at_terminal.py PROMPT=ANSWER... -- COMMAND...: runs COMMAND at a terminal of its own and types each ANSWER when its PROMPT
shows, in that order; ^C is an answer, too. Ends with the command's exit status. Knows nothing of what it runs."""
import os
import pty
import sys

end = sys.argv.index("--")
answers = [argument.split("=", 1) for argument in sys.argv[1:end]]
shown = b""


def read(terminal):
    global shown
    data = os.read(terminal, 4096)
    shown += data
    while answers and answers[0][0].encode() in shown:
        prompt, answer = answers.pop(0)
        shown = shown.split(prompt.encode(), 1)[1]
        os.write(terminal, b"\x03" if answer == "^C" else answer.encode() + b"\n")
    return data


status = os.waitstatus_to_exitcode(pty.spawn(sys.argv[end + 1:], read))
if answers:
    sys.exit(f"at_terminal: never asked: {answers}")
sys.exit(status)
