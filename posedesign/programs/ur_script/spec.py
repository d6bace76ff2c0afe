"""URScript as reader, writer and validator know it: functions, parameters, blocks, limits."""

from __future__ import annotations

from posedesign.programs.language import Block
from posedesign.programs.writing import NameRule

JOINTS = 6

MOST_JOINT_DEG = 363.0
"""Joint limits of the arms are no wider."""

MOST_OUTPUT = 7
"""Of the standard digital ones, which begin with 0."""

_NAMES = """
abs acos add_frame asin assert atan atan2 attach_frame binary_list_to_integer ceil convert_pose
conveyor_pulse_decode cos d2r direct_torque eip_reader_factory eip_writer_factory
enable_external_ft_sensor encoder_enable_pulse_decode encoder_enable_set_tick_count
encoder_get_tick_count encoder_set_tick_count encoder_unwind_delta_tick_count end_force_mode
end_freedrive_mode end_screw_driving end_teach_mode floor force force_mode force_mode_set_damping
force_mode_set_gain_scaling frame_exists freedrive_mode freedrive_mode_no_incorrect_payload_check
ft_rtde_input_enable get_actual_joint_positions get_actual_joint_positions_history
get_actual_joint_speeds get_actual_tcp_pose get_actual_tcp_speed get_actual_tool_flange_pose
get_analog_in get_analog_out get_configurable_digital_in get_configurable_digital_out
get_controller_temp get_conveyor_tick_count get_coriolis_and_centrifugal_torques get_digital_in
get_digital_out get_euromap_input get_euromap_output get_flag get_forward_kin get_frame_parent
get_freedrive_status get_gravity get_inverse_kin get_inverse_kin_has_solution get_jacobian
get_jacobian_time_derivative get_joint_positions get_joint_temp get_joint_torques get_list_length
get_mass_matrix get_pose get_robot_current get_rtde_value get_standard_analog_in
get_standard_analog_out get_standard_digital_in get_standard_digital_out get_steptime
get_target_joint_accelerations get_target_joint_positions get_target_joint_positions_along_path
get_target_joint_speeds get_target_payload get_target_payload_cog get_target_payload_inertia
get_target_tcp_pose get_target_tcp_pose_along_path get_target_tcp_speed
get_target_tcp_speed_along_path get_target_waypoint get_tcp_force get_tcp_offset
get_tool_accelerometer_reading get_tool_analog_in get_tool_current get_tool_digital_in
get_tool_digital_out halt high_holding_torque_disable high_holding_torque_enable
integer_to_binary_list interpolate_pose inv is_steady is_within_safety_limits join kill length log
make_list modbus_add_rw_signal modbus_add_signal modbus_delete_signal modbus_get_error
modbus_get_signal_status modbus_get_time_since_signal_invalid modbus_reset_connection
modbus_send_custom_command modbus_set_digital_input_action modbus_set_output_register
modbus_set_output_signal modbus_set_runstate_dependent_choice modbus_set_signal_update_frequency
modbus_set_signal_watchdog motion_version_set move_frame movec movej movel movep norm normalize
optimovej optimovel path_offset_disable path_offset_enable path_offset_get path_offset_set
path_offset_set_alpha_filter path_offset_set_max_offset pause_on_error_code point_dist popup
pose_add pose_dist pose_inv pose_sub pose_trans position_deviation_warning pow powerdown
protective_stop r2d random read_input_boolean_register read_input_float_register
read_input_integer_register read_output_boolean_register read_output_float_register
read_output_integer_register read_port_bit read_port_register remove_frame
request_boolean_from_primary_client request_float_from_primary_client
request_integer_from_primary_client request_string_from_primary_client reset_revolution_counter
reset_world_model rotvec2rpy rpc_factory rpy2rotvec rtde_set_watchdog run screw_driving servoc
servoj set_analog_inputrange set_analog_out set_analog_outputdomain set_base_acceleration
set_configurable_digital_input_action set_configurable_digital_out set_conveyor_tick_count
set_digital_out set_euromap_output set_euromap_runstate_dependent_choice set_flag
set_gp_boolean_input_action set_gravity set_input_actions_to_default set_payload set_payload_cog
set_payload_mass set_pos set_runstate_configurable_digital_output_to_value
set_runstate_gp_boolean_output_to_value set_runstate_standard_analog_output_to_value
set_runstate_standard_digital_output_to_value set_runstate_standard_digital_outputs
set_runstate_tool_digital_output_to_value set_safety_mode_transition_hardness
set_standard_analog_input_domain set_standard_analog_out set_standard_digital_input_action
set_standard_digital_out set_target_payload set_tcp set_tool_analog_input_domain
set_tool_communication set_tool_digital_input_action set_tool_digital_out
set_tool_digital_output_mode set_tool_output_mode set_tool_voltage sin size sleep socket_close
socket_get_var socket_open socket_read_ascii_float socket_read_binary_integer socket_read_byte_list
socket_read_line socket_read_string socket_send_byte socket_send_int socket_send_line
socket_send_string socket_set_var speedj speedl sqrt stop_conveyor_tracking stopj stopl str_at
str_cat str_empty str_find str_len str_sub struct sync tan teach_mode textmsg time to_num to_str
tool_contact tool_contact_examples tool_wrench_limit_disable tool_wrench_limit_set torque_command
track_conveyor_circular track_conveyor_linear transpose wrench_trans write_output_boolean_register
write_output_float_register write_output_integer_register write_port_bit write_port_register
zero_ftsensor
"""

FUNCTIONS = frozenset(_NAMES.split())
"""Of the manuals for CB3, e-Series and PolyScope X, and of Universal Robots' own examples; those of
URCaps are not among them."""

MOVES = ("movej", "movel", "movep")
"""That take joints or a pose."""

PARAMETERS = {
    name: (least, tuple(words.split()))
    for name, least, words in (
        ("movej", 1, "q a v t r"),
        ("movel", 1, "pose a v t r"),
        ("movep", 1, "pose a v r"),
        ("movec", 2, "pose_via pose_to a v r mode"),
        ("get_inverse_kin", 1, "x qnear maxPositionError maxOrientationError tcp"),
        ("pose_trans", 2, "p_from p_from_to"),
        ("set_tcp", 1, "pose tcp_name"),
        ("set_payload", 1, "m cog inertia_matrix"),
        ("sleep", 1, "t"),
        ("popup", 1, "s title warning error blocking"),
        ("request_boolean_from_primary_client", 1, "message"),
        ("textmsg", 1, "s1 s2"),
        ("sync", 0, ""),
        ("set_standard_digital_out", 2, "n b"),
        ("set_digital_out", 2, "n b"),
        ("get_actual_joint_positions", 0, ""),
        ("freedrive_mode", 0, "freeAxes feature"),
        ("end_freedrive_mode", 0, ""),
        ("write_output_integer_register", 2, "address value"),
        ("write_output_boolean_register", 2, "address value"),
        ("write_output_float_register", 2, "address value"),
    )
}
"""Arguments that a call must have, and the names of all that it can have."""

POSES = {
    ("get_inverse_kin", "x"),
    ("pose_trans", "p_from"),
    ("pose_trans", "p_from_to"),
    ("set_tcp", "pose"),
}
"""Parameters that are poses, never joints."""

BLOCKS = {
    "define": Block("end"),
    "thread": Block("end"),
    "secondary": Block("end"),
    "if_": Block("end", ("elif_", "else_")),
    "while_": Block("end"),
}

_WORDS = """and break continue def elif else end enter_critical exit_critical false for global halt
    if join kill local mod not or p pass return run sec switch thread true while xor"""
RESERVED = frozenset(word.upper() for word in (*_WORDS.split(), *FUNCTIONS))

NAMES = NameRule("a URScript name", 32, small=True, reserved=RESERVED)
"""Letters, digits and underscores; the length is that of other makers, no limit is known."""
