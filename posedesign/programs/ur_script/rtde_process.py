"""The process that listens to a controller: ``ADDRESS REGISTER``; a line of JSON for each package.

ur_rtde 1.6.5 waits without end for a controller that does not answer, ends its process at a package
that is shorter than its own header, and reads beyond one that is shorter than it should be. Here it
can: the process ends when nothing new came in time, with :data:`SILENT`, or when nobody reads what
it says. A line is ``[runtime_state, number, q, qd]``, or a text: why there are no more. With
:data:`UNLOADED` it ends where the library itself does not load.

Run by :mod:`posedesign.programs.ur_script.live` only, and imports nothing of the project, so that
it is there at once.
"""

import faulthandler
import json
import os
import signal
import sys
import time

RATE_HZ = 125.0  # the fastest that every controller has
CONNECT_S, SILENT_S = 15.0, 5.0  # longest wait for the first values, and for those that follow
SILENT = 1  # exit code of ``faulthandler`` when the time is over
UNLOADED, FAILED = 3, 4
"""Exit codes where ur_rtde does not load, and at errors that are not known here."""

UPPER = 24  # first register that is no field bus's; ur_rtde is told which half to read


def main(host: str, register: int) -> None:
    """Say what the controller sends until it ends."""
    faulthandler.dump_traceback_later(CONNECT_S, exit=True)  # also while ur_rtde holds the GIL
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started this ends it, too
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # ur_rtde prints what controllers say
    variables = ["timestamp", "actual_q", "actual_qd", "runtime_state"]
    variables.append(f"output_int_register_{register}")
    code = FAILED
    try:
        from rtde_receive import RTDEReceiveInterface

        arm = RTDEReceiveInterface(host, RATE_HZ, variables, False, register >= UPPER)
        said = None
        while arm.isConnected():
            now = arm.getTimestamp()
            values = [arm.getRuntimeState(), arm.getOutputIntRegister(register)]
            values += [arm.getActualQ(), arm.getActualQd()]
            if now != said and arm.getTimestamp() == now:  # all of one package
                out.write(json.dumps(values) + "\n")
                said = now
                faulthandler.dump_traceback_later(SILENT_S, exit=True)
            time.sleep(0.2 / RATE_HZ)
        out.write('"the connection was closed"\n')
        code = 0
    except BrokenPipeError:
        code = 0
    except IndexError:  # of joint values that never came
        out.write('"the connection was closed before any values came"\n')
        code = 0
    except (ImportError, RuntimeError, ValueError) as error:
        lines = str(error).strip().splitlines() or [type(error).__name__]
        out.write(json.dumps(lines[0][:200]) + "\n")
        code = UNLOADED if isinstance(error, ImportError) else 0
    finally:
        os._exit(code)  # ur_rtde would wait for its threads


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
