import sys
import time
from xarm.wrapper import XArmAPI

def MEASURE(number):
    input(f"Is the tool at its target? Pose {number}, Enter: ")
    print(f"POSE {number} q={arm.get_servo_angle(is_radian=False)}")

def check(code):
    if code:  # the library raises no error
        sys.exit(f"the controller answers with code {code}")

# cell 7
# PLAN abcdef12 2 1 0d9fe5fe
# * NOT CHECKED: signs, zeros and couplings of the joints, which are those of the robot's description
arm = XArmAPI(sys.argv[1])
check(arm.motion_enable(enable=True))
check(arm.set_mode(0))
check(arm.set_state(state=0))
# POSE 1 T 1
check(arm.set_servo_angle(angle=[0.000000, 15.000000, -25.000000, -0.000001, -50.000000, 30.000000], speed=95.00, is_radian=False, wait=True))
time.sleep(0.300)
check(arm.set_cgpio_digital(5, 1))
time.sleep(0.500)
check(arm.set_cgpio_digital(5, 0))
MEASURE(1)
# POSE 3 over
check(arm.set_servo_angle(angle=[10.000000, 15.000000, 20.000000, 5.000000, 25.123456, 0.000000], speed=95.00, is_radian=False, wait=True))
# POSE 2
# mind the cable
check(arm.set_servo_angle(angle=[-160.000000, 20.000000, 10.000000, 0.500000, -5.000000, 260.000000], speed=95.00, is_radian=False, wait=True))
time.sleep(0.300)
check(arm.set_cgpio_digital(5, 1))
time.sleep(0.500)
check(arm.set_cgpio_digital(5, 0))
MEASURE(2)
arm.disconnect()
