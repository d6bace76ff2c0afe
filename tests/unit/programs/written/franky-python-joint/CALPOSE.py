import sys
import time
from franky import JointMotion, Robot

def MEASURE(number):
    input(f"Is the tool at its target? Pose {number}, Enter: ")
    print(f"POSE {number} q={list(robot.current_joint_state.position)}")

# cell 7
# PLAN abcdef12 2 1 38cf55f9
robot = Robot(sys.argv[1])
robot.relative_dynamics_factor = 0.25
# POSE 1 T 1
robot.move(JointMotion([0.0000000, 0.2617994, -0.4363323, 0.0000000, -0.8726646, 0.5235988, 0.0000000]))
time.sleep(0.300)
MEASURE(1)
# POSE 3 over
robot.move(JointMotion([0.1745329, 0.2617994, 0.3490659, 0.0872665, 0.4384870, 0.0000000, 0.1745329]))
# POSE 2
# mind the cable
robot.move(JointMotion([-2.7925268, 0.3490659, 0.1745329, 0.0087266, -0.0872665, 4.5378561, -2.7925268]))
time.sleep(0.300)
MEASURE(2)
