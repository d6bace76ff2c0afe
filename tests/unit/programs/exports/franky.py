from franky import *

robot = Robot("10.90.90.1")  # Replace this with your robot's IP
robot.recover_from_errors()
robot.relative_dynamics_factor = 0.05
home = JointMotion([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
robot.move(home)
motion = CartesianMotion(Affine([0.2, 0.0, 0.0]), ReferenceType.Relative)
robot.move(JointWaypointMotion([
    JointWaypoint([-0.3, 0.1, 0.3, -1.4, 0.1, 1.8, 0.7]),
    JointWaypoint([0.0, 0.3, 0.3, -1.5, -0.2, 1.5, 0.8]),
]), asynchronous=True)
robot.move(JointMotion(JointState([0.1, 0.3, 0.3, -1.5, -0.2, 1.5, 0.8])))
