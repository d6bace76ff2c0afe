Function CALPOSE
  ' cell 7
  ' PLAN abcdef12 2 1 3787f901
  ' * NOT CHECKED: signs, zeros and couplings of the joints, which are those of the robot's description
  Motor On
  Power High
  Speed 25
  ' POSE 1 T 1
  Go AglToPls(0.000000, 15.000000, -25.000000, -0.000001, -50.000000, 30.000000)
  Wait 0.300
  On 5
  Wait 0.500
  Off 5
  Call MEASURE(1)
  ' POSE 3 over
  Go AglToPls(10.000000, 15.000000, 20.000000, 5.000000, 25.123456, 0.000000)
  ' POSE 2
  ' mind the cable
  Go AglToPls(-160.000000, 20.000000, 10.000000, 0.500000, -5.000000, 260.000000)
  Wait 0.300
  On 5
  Wait 0.500
  Off 5
  Call MEASURE(2)
Fend
