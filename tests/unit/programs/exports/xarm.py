"""An example of a person."""
import sys
import time

from xarm.wrapper import XArmAPI

ip = sys.argv[1] if len(sys.argv) > 1 else "192.168.1.200"
arm = XArmAPI(ip)
arm.motion_enable(enable=True)
arm.set_mode(0)
arm.set_state(state=0)
home = [0, -30.5, -60, 0, 0, 15]

arm.move_gohome(wait=True)
speed = 50
arm.set_servo_angle(angle=[90, 0, -60, 0, 0, 0], speed=speed, wait=True)
print(arm.get_servo_angle(), arm.get_servo_angle(is_radian=True))
arm.set_position(x=300, y=0, z=200, roll=180, pitch=0, yaw=0, wait=True)
arm.set_servo_angle(angle=home, speed=speed, wait=True)
arm.set_servo_angle(angle=[0.5, -0.25, -1.0, 0, 0, 0], speed=5, is_radian=False)
time.sleep(0.5)
arm.disconnect()
