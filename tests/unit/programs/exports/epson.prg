#include "cell.inc"
Global Integer g_total

Function main
	Integer i
	Reset
	If Motor = Off Then
		Motor On
	EndIf
	Power High
	Speed 50
	Accel 50, 50 'as taught
	SpeedS 500
	Go JA(-46.18419, -6.77518, -20.54925, 71.38674, 49.58727, -302.54752)
	Wait Sw(8) = On
	For i = 1 To 2
		Jump P2 C0
		On gripper
	Next i
	Go AglToPls(-41.62707, -8.89064, -30.01809, 60.62329, 0, -258.98418) CP
	Go pick +Z(50)
	Call Probe(1)
	Off 8
Fend

Function Probe(n As Integer)
	Select n
		Case 1
			Print "probe ", n
	Send
Fend
