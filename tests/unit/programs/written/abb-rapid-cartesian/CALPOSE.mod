MODULE CALPOSE
  ! cell 7
  ! PLAN abcdef12 2 1 6b3dc68f
  ! the load of tCalib is not known: set its mass and centre
  TASK PERS tooldata tCalib:=[TRUE,[[10.0000,-20.0000,150.0000],[0.707106781,0.000000000,0.707106781,0.000000000]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata wCalib:=[FALSE,TRUE,"",[[500.0000,100.0000,-50.0000],[0.707106781,0.000000000,0.000000000,0.707106781]],[[0,0,0],[1,0,0,0]]];
  ! P1 T 1
  LOCAL CONST robtarget p1:=[[-112.3205,17.7020,905.1058],[0.499999994,0.499999999,0.683012705,-0.183012707],[0,0,0,1],[9E9,9E9,9E9,9E9,9E9,9E9]];
  LOCAL CONST robtarget p2:=[[-298.5851,1065.2854,428.8926],[0.530061098,-0.611281734,0.226648274,-0.542218069],[-2,0,2,1],[9E9,9E9,9E9,9E9,9E9,9E9]];
  ! P3 over
  LOCAL CONST robtarget p3:=[[-31.1267,46.5147,286.3370],[0.355437575,-0.558670715,-0.659956302,-0.354977240],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  ! jMeasured{2} IS P1
  LOCAL PERS jointtarget jMeasured{3}:=[
    [[9E9,9E9,9E9,9E9,9E9,9E9],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[9E9,9E9,9E9,9E9,9E9,9E9],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[9E9,9E9,9E9,9E9,9E9,9E9],[9E9,9E9,9E9,9E9,9E9,9E9]]];
  LOCAL CONST speeddata vCalib:=[1250,125,1250,250];
  ! * start it with PP to Routine CALPOSE_run
  PROC CALPOSE_run()
    ConfJ\On;
    ! P1 T 1
    MoveJ p1,vCalib,fine,tCalib\WObj:=wCalib;
    WaitTime\InPos,0.30;
    PulseDO\PLength:=0.500,do5;
    MEASURE 1;
    jMeasured{2}:=CJointT();
    ! P3 over
    MoveJ p3,vCalib,fine,tCalib\WObj:=wCalib;
    ! mind the cable
    MoveJ p2,vCalib,fine,tCalib\WObj:=wCalib;
    WaitTime\InPos,0.30;
    PulseDO\PLength:=0.500,do5;
    MEASURE 2;
    jMeasured{3}:=CJointT();
  ENDPROC
ENDMODULE
