%%%
  VERSION:1
  LANGUAGE:ENGLISH
%%%

MODULE TouchUp(SYSMODULE, NOSTEPIN)
  ! after service; "not a string
  ! PLAN 00c0ffee 10
  PERS tooldata tProbe:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata wTable:=[FALSE,TRUE,"",[[500,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  CONST robtarget p10:=[[600.5,-10,700.25],[0.70710678,0,0.70710678,0],[0,-1,0,1],
    [9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  LOCAL CONST
    jointtarget jp2 := [ [ 10 , -5.5 , +20 ,
       .5, 45., -30 ] , [ 500 , 9E9,9E9, 9E9,9E9,9E9 ] ] ; ! touched ; up
  PERS jointtarget jHome:=[[0,0,0,0,30,0],[0,9E9,9E9,9E9,9E9,9E9]];
  pers robtarget Corner:=[[1,2,3],[1,0,0,0],[0,0,0,0],[500.001,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget jTable{2}:=[[[1,2,3,4,5,6],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[6,5,4,3,2,1],[9E9,9E9,9E9,9E9,9E9,9E9]]];
  VAR robtarget pScratch;
  PERS robtarget pEmpty:=[[0,0,0],[0,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PERS jointtarget jTrack:=[[9E9,9E9,9E9,9E9,9E9,9E9],[7220,9E9,9E9,9E9,9E9,9E9]];
  VAR num values{2,3}:=[[1,2,3],[4,5,6]];
  CONST pose frame1:=[[1,2,3],[1,0,0,0]];
  CONST string text:="CONST jointtarget p5:=[[1]]; ! x";

  LOCAL PROC go(VAR robtarget target, num n)
    MoveL Offs(target,0,0,50),v100,z10,tProbe\WObj:=wTable;
  ENDPROC

  PROC main()
    VAR robtarget here;
    here:=CRobT(\Tool:=tProbe);
    MoveAbsJ jHome\NoEOffs,v200,fine,tool0;
    MoveAbsJ [[7,8,9,10,11,12],[500,9E9,9E9,9E9,9E9,9E9]]\NoEOffs,v200,fine,tool0;
    MoveJ\Conc, [[1,2,3],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]], v200, z5, tool0;
    IF TRUE THEN
      go p10,1;
    ENDIF
  ENDPROC
ENDMODULE
