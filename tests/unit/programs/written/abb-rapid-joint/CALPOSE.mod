MODULE CALPOSE
  ! cell 7
  ! PLAN abcdef12 2 1 785c273f
  ! P1 T 1
  LOCAL CONST jointtarget jp1:=[[0.00000,15.00000,-25.00000,0.00000,-50.00000,30.00000],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST jointtarget jp2:=[[-160.00000,20.00000,10.00000,0.50000,-5.00000,260.00000],[9E9,9E9,9E9,9E9,9E9,9E9]];
  ! P3 over
  LOCAL CONST jointtarget jp3:=[[10.00000,15.00000,20.00000,5.00000,25.12346,0.00000],[9E9,9E9,9E9,9E9,9E9,9E9]];
  ! jMeasured{2} IS P1
  LOCAL PERS jointtarget jMeasured{3}:=[
    [[9E9,9E9,9E9,9E9,9E9,9E9],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[9E9,9E9,9E9,9E9,9E9,9E9],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[9E9,9E9,9E9,9E9,9E9,9E9],[9E9,9E9,9E9,9E9,9E9,9E9]]];
  LOCAL CONST speeddata vCalib:=[1250,125,1250,250];
  ! * start it with PP to Routine CALPOSE_run
  PROC CALPOSE_run()
    ! P1 T 1
    MoveAbsJ jp1\NoEOffs,vCalib,fine,tool0;
    WaitTime\InPos,0.30;
    PulseDO\PLength:=0.500,do5;
    MEASURE 1;
    jMeasured{2}:=CJointT();
    ! P3 over
    MoveAbsJ jp3\NoEOffs,vCalib,fine,tool0;
    ! mind the cable
    MoveAbsJ jp2\NoEOffs,vCalib,fine,tool0;
    WaitTime\InPos,0.30;
    PulseDO\PLength:=0.500,do5;
    MEASURE 2;
    jMeasured{3}:=CJointT();
  ENDPROC
ENDMODULE
